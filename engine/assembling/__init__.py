"""Putting the panels together: order, check, assembly sheet and film."""
