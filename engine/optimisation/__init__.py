"""Optimisation of the spirals: objective, adjoint gradients, optimisers, co-design of flat shapes, limits of the match."""
