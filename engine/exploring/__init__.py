"""Which size, thickness, material and spirals suit a piece best: many candidates tried beside each other."""
