"""Clearances of a flat design: slots, gaps between arms, and repair of closed gaps. Theory: docs/clearance.md."""
