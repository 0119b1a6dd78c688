"""Quads that follow the surface's curvature: so far the field of directions that they are to follow."""
