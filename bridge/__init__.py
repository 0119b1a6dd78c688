"""The only place where Blender and the engine meet: meshes, settings, the background job, finished scenes."""
