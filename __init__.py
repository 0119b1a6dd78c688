"""FlexMaps for Blender: from a quad mesh to flat sheets that spring into its shape."""
