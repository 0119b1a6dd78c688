"""Distance from which on a shape visibly differs from its target; no numpy is imported, so the sidebar draws fast."""

# RMS distance from the target, as a share of the piece's diagonal, above which anybody sees the difference (8 mm on
# 400 mm); smaller values warn about more pieces
VISIBLE_RMS_SHARE = 0.02
