"""The calibration sheet, and what is measured on it: kerf, clearance and stiffness of the user's own machine and material."""
