"""Cut patches larger than the sheet along straight runs of edges."""
