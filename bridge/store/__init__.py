"""A piece's data in Blender: the mesh, its attributes and notes, the settings, and the state of every stage."""
