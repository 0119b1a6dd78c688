"""The numerical engine of FlexMaps: numpy and scipy, SI units, no Blender.

Data flows in one direction; each arrow is a function in the folder named below it:

    PolygonMesh -> QuadMesh -> PatchLayout -> FlatPatches -> SpiralDesign -> CutSheets -> files
            surface        patches        patches       spirals        fabrication   fabrication

``mechanics`` computes the shape of a design, ``optimisation`` the design for a shape, ``fabrication`` panels and the
order in which they are joined; ``runs`` runs all stages, and ``extras`` holds optional functions. The modules directly
in this folder are shared by all others. Folders of earlier stages do not import from later ones; nothing imports
``bpy``.
"""

import re as _re
from pathlib import Path as _Path

MANIFEST = _Path(__file__).resolve().parents[1] / "blender_manifest.toml"  # the only place that states the version
PROGRAM = "FlexMaps for Blender"
VERSION = _re.search(r'^version = "(.+)"', MANIFEST.read_text(encoding="utf-8"), _re.MULTILINE)[1]  # type: ignore[index]
MARK = f"{PROGRAM} {VERSION}"  # written into all output files except tables and PNG pictures
