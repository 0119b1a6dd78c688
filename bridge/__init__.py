"""Code that uses both Blender and the engine: reading meshes and settings, the background job, writing scenes."""
