"""From which distance on a shape lies visibly off its target. Imports no numerics, so that a sidebar can be drawn."""

FAR = 0.02  # RMS distance as a share of the piece's diagonal that anybody sees at once: 8 mm on 400 mm
