"""Flatten patches as rigidly as possible, with seam sides of equal lengths, and measure the distortion."""
