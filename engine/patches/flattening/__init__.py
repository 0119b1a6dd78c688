"""Flatten patches as rigidly as possible, with equally long sides of every seam, and measure the distortion."""
