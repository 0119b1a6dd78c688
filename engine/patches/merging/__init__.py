"""Reduce the number of patches: remove, straighten and redraw seams within all limits."""
