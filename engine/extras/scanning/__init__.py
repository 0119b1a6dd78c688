"""Comparison of the built, scanned piece with its predicted shape."""
