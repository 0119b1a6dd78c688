"""The surface: polygon files, quad meshes, what is wrong with them, curvature, symmetry, and squarer quads."""
