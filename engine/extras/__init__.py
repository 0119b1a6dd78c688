"""Optional features beside the main job (mesh to cutting files); each folder can be removed alone."""
