"""The first layout: cuts along lines of quads, or between regions."""
