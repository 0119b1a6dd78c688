"""Widths of the slots between the bent arms of an assembled piece (docs/clearance.md).

``slot_estimate`` is fast and has derivatives, for the search for a design; ``slots_in_space`` measures results.
"""
