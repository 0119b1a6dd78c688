"""What the sidebar needs to know about distances from the target; no numpy is imported, so it draws fast."""

# RMS distance from the target, as a share of the piece's diagonal, above which anybody sees the difference (8 mm on
# 400 mm); smaller values warn about more pieces
VISIBLE_RMS_SHARE = 0.02
REMEDY_WORDS = "To bring it nearer, "  # first words of the remedies for a body that is far from its target
