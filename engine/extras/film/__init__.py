"""Film of the assembly: unfinished pieces at rest, and panels that fly to their places and are joined seam by seam."""
