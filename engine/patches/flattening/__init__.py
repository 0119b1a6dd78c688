"""Patches in the plane: as rigid as possible, with sides of seams of equal length, and what that costs."""
