"""Elastic models of spirals and of whole assemblies, and their equilibrium."""
