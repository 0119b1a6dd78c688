"""Pictures of one piece with several kinds of border, side by side."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from flexmaps.engine.params import ObjectSettings, RenderParams
from flexmaps.engine.runs.result import Result

WIDTH, SAMPLES = 800, 12  # pixels of every piece, and samples of each; by eye


def beside_each_other(pieces: dict[str, Result], path: Path) -> None:
    """Renders the assembled pieces, which have their border's kind as name, and writes one picture of all."""
    import bpy
    from flexmaps.bridge.hosts import job_folder
    from flexmaps.bridge.view import picture, scene
    from PIL import Image

    if not hasattr(bpy.types.Object, "flexmaps"):
        import flexmaps

        flexmaps.register()
    shown = RenderParams(
        target=False, panels=False, finish="PATCH", pixels_x=WIDTH, samples=SAMPLES, elevation=np.radians(38.0)
    )
    images = []
    with tempfile.TemporaryDirectory() as folder, job_folder.quiet_blender():
        for kind, made in pieces.items():
            bpy.ops.wm.read_factory_settings(use_empty=True)
            settings = ObjectSettings()
            obj = scene.show(made, kind, replace(settings, spiral=replace(settings.spiral, border=kind)))
            picture.together(obj, Path(folder) / f"{kind}.png", shown)
            images.append(Image.open(Path(folder) / f"{kind}.png").convert("RGB"))
    whole = Image.new("RGB", (sum(one.width for one in images), max(one.height for one in images)), "white")
    left = 0
    for one in images:
        whole.paste(one, (left, whole.height - one.height))
        left += one.width
    path.parent.mkdir(parents=True, exist_ok=True)
    whole.save(path)
