"""Clearances of the assembled piece: slots between bent arms, estimated in searches and measured in results. Theory: docs/clearance.md."""
