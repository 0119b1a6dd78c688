"""The microstructure: outlines of spirals, how far they may wind, and the design of a whole surface."""
