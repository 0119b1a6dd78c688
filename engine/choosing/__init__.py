"""Which layout of patches to make: proposals judged by the shape that the assembled panels take."""
