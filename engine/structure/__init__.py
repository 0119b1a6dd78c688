"""What a piece bears: load cases, how far it gives way under them, and how far they may rise until it snaps."""
