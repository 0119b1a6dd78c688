"""Exploration: vary size, thickness, material and spirals of a piece, and compare many candidates."""
