"""All stages one after another, and what is told of a run: figures, plots and the report."""
