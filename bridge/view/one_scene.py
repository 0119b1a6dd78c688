"""A .blend file that holds one scene of the open file, with all that it shows."""

from __future__ import annotations

from pathlib import Path

import bpy


def write(path: Path, scene: bpy.types.Scene, compress: bool = False) -> None:
    """Write it. Raises ``RuntimeError`` or ``OSError``, as Blender does, where that cannot be."""
    # Blender 5.2 breaks down where it writes a scene whose view layers were never brought up to date
    for layer in scene.view_layers:
        layer.update()
    bpy.data.libraries.write(str(path), {scene}, compress=compress)
