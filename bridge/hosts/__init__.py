"""Threads and processes that run the engine (background job, live mode, second Blender), and the main job's folder."""
