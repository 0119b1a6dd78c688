"""Constants about distances from the target, for the sidebar; without numpy, so that the sidebar draws fast."""

# Everybody sees that a piece differs from its target if the RMS distance is above this share of the piece's diagonal (8
# mm on 400 mm); smaller values warn about more pieces
VISIBLE_RMS_SHARE = 0.02
# first words of the message with remedies for a body that is far from its target
REMEDY_WORDS = "To bring it nearer, "
