"""Connectors between panels: shapes of dovetails, keys and tabs, and the search for positions with room."""
