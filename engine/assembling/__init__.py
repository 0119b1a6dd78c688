"""Assembly of the panels: check of the seams, assembly sheet and film."""
