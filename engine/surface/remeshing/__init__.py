"""Quad remeshing of any mesh, and regularisation of quads towards squares."""
