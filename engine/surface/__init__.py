"""The surface: mesh files, quad meshes, mesh checks, curvature, symmetry and remeshing."""
