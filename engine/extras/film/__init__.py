"""Film of the assembly: panels fly to their places and are joined seam by seam to an unfinished piece."""
