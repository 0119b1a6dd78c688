"""Bases: feet at the ends of panels, plates with slots for them, and eyelets."""
