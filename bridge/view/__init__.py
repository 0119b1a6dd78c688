"""Everything that is drawn or shown: overlays, previews, pictures, animations, and the objects beside the model."""
