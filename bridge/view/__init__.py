"""Drawing and display: overlays, previews, pictures, animations, and the objects beside the model."""
