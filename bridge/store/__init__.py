"""Data of a piece in Blender: mesh, attributes, stored results and states of the stages, settings."""
