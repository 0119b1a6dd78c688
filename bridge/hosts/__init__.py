"""Processes and threads that run the engine: the background job, live mode, a second Blender; and the main job's folder."""
