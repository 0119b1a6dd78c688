"""What runs the engine: the background job, the main job in a folder, a second Blender."""
