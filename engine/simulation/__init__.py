"""Simulate the shape that an assembled design takes, and find what a maker should know about it."""
