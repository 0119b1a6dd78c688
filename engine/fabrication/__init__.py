"""From a design to what is cut or printed: connectors, labels, kerf, tool paths, nesting, sheets and their files."""
