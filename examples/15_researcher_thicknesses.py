"""For the researcher: the same layout in sheets of several thicknesses, compared in a table and a CSV file.

    blender -b --python examples/15_researcher_thicknesses.py -- shape:vault sweep 1.5 2 3

The first word is a mesh (or shape:NAME), the second a folder, the rest are thicknesses in millimetres. Each variant goes on from the
same flat patches, so that only the thickness differs; every variant also gets its own report.html.
"""

import csv
import sys
from pathlib import Path

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

COLUMNS = ("thickness_mm", "rmse_before_mm", "rmse_mm", "rms_percent", "strain_share_max", "seconds")


def variant(piece: "api.Piece", thickness: float, out: Path) -> dict:
    """One row of the table."""
    made = api.optimise(api.change(piece, {"spiral.thickness": thickness}))
    found = api.report(made, out / f"{thickness:g}mm")
    return {
        "thickness_mm": thickness,
        "rmse_before_mm": found["optimise"]["laplacian_rmse_mm_before"],
        "rmse_mm": found["equilibrium"]["laplacian_rmse_mm"],
        "rms_percent": found["equilibrium"]["rms_percent"],
        "strain_share_max": found["equilibrium"]["strain_share_max"],
        "seconds": found["seconds"]["optimise"],
    }


def main(words: list) -> list:
    """Sweep, print, and write sweep.csv; returns the rows."""
    source, out = words[0], Path(words[1])
    thicknesses = [float(word) for word in words[2:]] or [1.0, 2.0, 3.0]
    piece = api.layout(api.load(source, edge=20, supports="lowest"))
    rows = [variant(piece, thickness, out) for thickness in thicknesses]
    print("  ".join(f"{name:>16}" for name in COLUMNS))
    for row in rows:
        print("  ".join(f"{row[name]:16.4g}" for name in COLUMNS))
    with open(out / "sweep.csv", "w", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    return rows


if __name__ == "__main__":
    rows = main(sys.argv[sys.argv.index("--") + 1 :])
