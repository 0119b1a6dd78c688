"""Run all stages in order, and report a run: figures, plots, the report and its 3D page."""
