"""A piece that follows what is changed of it: its equilibrium from the last one on, step by step."""
