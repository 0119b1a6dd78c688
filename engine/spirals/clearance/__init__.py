"""Clearances of a flat design: slots and gaps between its arms, and the change that opens closed ones. Theory: docs/clearance.md."""
