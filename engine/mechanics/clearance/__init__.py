"""Slots between the bent arms of an assembled piece: estimated in searches, measured in results (docs/clearance.md)."""
