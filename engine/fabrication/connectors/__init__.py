"""Connectors between panels: dovetails, keys and tabs, their positions, and a check of their fit."""
