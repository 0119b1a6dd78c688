"""From a design to the shape that its assembled object takes, and what a maker wants to know about it."""
