"""The numerical engine of FlexMaps: numpy and scipy, SI units, no Blender.

One datum goes one way, each arrow a function of a module in the folder below it:

    PolygonMesh -> QuadMesh -> PatchLayout -> FlatPatches -> SpiralDesign -> CutSheets -> files
            surface        patches        patches       spirals        fabrication   fabrication

``mechanics`` finds the shape of a design, ``optimisation`` the design of a shape, ``assembling`` tells how the panels go
together and ``runs`` does all of it at once. What every folder shares lies here. Modules import downward only; nothing
here imports ``bpy``.
"""

import re as _re
from pathlib import Path as _Path

MANIFEST = _Path(__file__).resolve().parents[1] / "blender_manifest.toml"  # the one place where the version stands
PROGRAM = "FlexMaps for Blender"
VERSION = _re.search(r'^version = "(.+)"', MANIFEST.read_text(encoding="utf-8"), _re.MULTILINE)[1]  # type: ignore[index]
MARK = f"{PROGRAM} {VERSION}"  # in every file that the program writes, but for tables and PNG pictures
