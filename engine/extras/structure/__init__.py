"""Load analysis: load cases, deflection and use of arms and joints, and the load at which a piece snaps."""
