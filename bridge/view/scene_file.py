"""Write a .blend file with one scene of the open file and all data that the scene uses."""

from __future__ import annotations

from pathlib import Path

import bpy


def write_scene(path: Path, scene: bpy.types.Scene, compress: bool = False) -> None:
    """Write a scene to a new .blend file; raise ``RuntimeError`` or ``OSError`` on failure, as Blender does."""
    # Blender 5.2 crashes when it writes a scene whose view layers were never updated
    for layer in scene.view_layers:
        layer.update()
    bpy.data.libraries.write(str(path), {scene}, compress=compress)
