"""Assemblies of spirals, what holds and loads them, and their equilibrium; the elastic models are in ``arms`` and ``rods``."""
