"""The microstructure: shape and outlines of spirals, their clearances, and the design of a whole surface."""
