"""Distance at which a shape visibly misses its target; imports no numerics, so that the sidebar draws fast."""

# RMS distance from the target, as a share of the piece's diagonal, above which anybody sees that the shape differs:
# 8 mm on 400 mm; smaller values warn about more pieces
VISIBLE_RMS_SHARE = 0.02
