"""One panel: outline with kerf, labels, and toolpath."""
