"""One panel: its outline after kerf, its labels, and how the cutter runs along it."""
