"""What is drawn of a piece: flat patches beside each other, panels as bodies, drawings and plots, for any screen or paper."""
