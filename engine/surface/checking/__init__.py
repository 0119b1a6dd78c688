"""Checks of a polygon mesh, and its conversion to a quad mesh if it has no errors."""
