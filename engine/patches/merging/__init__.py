"""Fewer patches: seams opened, straightened and drawn anew while every limit holds."""
