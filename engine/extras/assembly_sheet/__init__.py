"""Assembly sheet: a printable guide that shows how to put the panels together, step by step."""
