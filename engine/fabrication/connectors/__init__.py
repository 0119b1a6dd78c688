"""The joints between panels: dovetails, keys and tabs, where they fit, and whether they go together."""
