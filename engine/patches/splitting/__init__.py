"""Patches larger than the sheet, cut along straight runs of edges."""
