"""Reduce the number of patches: open, straighten and redraw seams within all limits."""
