"""From a design to files for cutting or printing: connectors, labels, kerf, toolpaths, nesting and sheets."""
