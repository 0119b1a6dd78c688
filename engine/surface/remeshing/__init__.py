"""Quads for any mesh, and squarer quads."""
