"""Files of the sheets: SVG, DXF, PDF, STL and 3MF."""
