"""What there is to see: overlays, previews, pictures, animations, and the objects beside the model."""
