"""Exploration: compare many candidates to find the size, thickness, material and spirals that suit a piece best."""
