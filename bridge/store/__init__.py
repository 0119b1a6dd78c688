"""What Blender's data holds of a piece: the mesh, its attributes and notes, settings, and how far every stage is."""
