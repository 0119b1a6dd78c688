"""The built piece, scanned, beside the shape that was predicted."""
