"""Geometry and drawings for display: patches side by side, panels as bodies, plots and maps, for any screen or paper."""
