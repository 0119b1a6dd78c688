"""Assemblies of spirals, their supports and loads, and their equilibrium; ``arms`` and ``rods`` hold the elastic models."""
