"""For the maker: a folder of meshes in, nested sheets out, one folder for each mesh.

    blender -b --python examples/14_maker_folder_of_meshes.py -- MESHES OUT [EDGE] [SHEET_WIDTH SHEET_HEIGHT]

EDGE is the length of the quads in millimetres, 20 if it is not given. A mesh that is not made of quads gets new ones first. What
cannot be made is named at the end and does not stop the rest.
"""

import sys
from pathlib import Path

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

SETTINGS = {"connect.connector": "dovetail", "cut.kerf_outline": 0.15, "cut.kerf_holes": 0.15}  # measure your own kerf
SUFFIXES = (".obj", ".ply", ".stl", ".off")


def make(mesh: Path, out: Path, edge: float, settings: dict) -> str:
    """Write everything for one mesh; returns a line about it."""
    quads = None
    if any(finding.is_error for finding in api.check(api.load(mesh, edge=edge))):
        quads = 500
    made = api.run(mesh, out / mesh.stem, edge=edge, quads=quads, settings=settings, optimised=True, pictures=False)
    sheets = made["sheets"]
    return f"{sheets['sheets']} sheets, {sheets['cut_length_m']:.1f} m of cuts, {sheets['mass_g']:.0f} g"


def main(words: list) -> int:
    """Go through the folder; returns how many meshes could not be made."""
    meshes, out = Path(words[0]), Path(words[1])
    edge = float(words[2]) if len(words) > 2 else 20.0
    settings = dict(SETTINGS)
    if len(words) > 4:
        settings |= {"sheet.sheet_width": words[3], "sheet.sheet_height": words[4]}
    refused = []
    for mesh in sorted(path for path in meshes.iterdir() if path.suffix.lower() in SUFFIXES):
        try:
            print(f"{mesh.name}: {make(mesh, out, edge, settings)}")
        except api.FlexMapsError as error:
            refused.append(mesh.name)
            print(f"{mesh.name}: {error}")
    print(f"{len(refused)} refused: {', '.join(refused)}" if refused else "all made")
    return len(refused)


if __name__ == "__main__":
    refused_count = main(sys.argv[sys.argv.index("--") + 1 :])
