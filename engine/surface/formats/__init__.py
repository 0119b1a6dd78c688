"""Readers of mesh files: OBJ, OFF, PLY, STL."""
