"""Geometry and drawings for display: arranged patches, panels as meshes, plots and maps."""
