"""Live pieces: after every change the equilibrium is solved again in small steps, from the present pose."""
