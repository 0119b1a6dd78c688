"""The first layout, before merging: cuts along lines of edges, or between regions of quads."""
