"""Live pieces: after every change, the equilibrium is solved again, step by step, from the last one."""
