"""Assemblies of spirals, their supports, loads and equilibria; the elastic models are in ``arms`` and ``rods``."""
