"""Running all stages in order, and reporting a run: figures, plots, the report and its 3D page."""
