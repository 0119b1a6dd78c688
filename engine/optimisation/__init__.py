"""Choosing the spirals: objective, adjoint gradients, optimisers, flat shapes that move too, and what limits a match."""
