"""Curves of single arms in real quads: arcs, spirals, and their blends at the joints."""
