"""Quad meshes whose edges follow the surface's curvature: cross field, seamless map, extraction of quads."""
