"""Simulate the shape that an assembled design takes, and report to users what may be wrong with it."""
