"""Optimise spirals and flat shapes: objective, adjoint gradients, optimiser, and why a piece misses its target."""
