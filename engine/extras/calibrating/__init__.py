"""Calibration sheet and its evaluation: kerf, clearance and stiffness of the user's own machine and material."""
