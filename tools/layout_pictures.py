"""Ten surfaces as they are laid out by default, and below each the layout that *Propose layouts* takes: docs/images/layouts_chosen.png.

python3 tools/dev.py python tools/layout_pictures.py [--store FOLDER]

A surface takes a minute or two; with ``--store`` what was found is kept there, and not computed again. Look at the picture before you
commit it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bench_first
import numpy as np
import zoo
from flexmaps.engine.display import plots, raster
from flexmaps.engine.params import Settings
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.runs import job
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh
from harness import EDGE, from_blender
from PIL import Image, ImageDraw, ImageFont
from zoo import trial

TARGET = Path(__file__).resolve().parent.parent / "docs" / "images" / "layouts_chosen.png"
QUADS = 500  # of what is remeshed
# title: where the surface comes from, its name there
SURFACES = {
    "Elbow": ("zoo", "elbow"),
    "Terrain": ("zoo", "terrain-steep"),
    "Cone": ("first", "cone"),
    "Sphere and cube": ("first", "boolean"),
    "Ball": ("zoo", "thirds-ball240"),
    "Suzanne, subdivided": ("first", "subdivided monkey"),
    "Mask": ("first", "mask"),
    "Double torus": ("zoo", "genus2"),
    "Cube": ("first", "cube"),
    "Cylinder": ("first", "cylinder"),
}
COLUMNS, SIDE, GAP, TITLE, LINE = 5, 150, 10, 22, 36  # pictures a row, and pixels, SIDE before ``raster.PIXEL_SCALE``
COLOURS = 255  # of the picture


@dataclass(frozen=True)
class Pair:
    """A surface with two layouts: quads, and for each where it is cut, (E,) bool, and its RMS distance in percent of the size."""

    mesh: QuadMesh
    cuts: np.ndarray
    percent: np.ndarray


def main(arguments: list[str]) -> int:
    """Compute what is not stored, and draw all of it."""
    parser = argparse.ArgumentParser(prog="layout_pictures.py")
    parser.add_argument("--store", type=Path, help="folder of what was found")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        store = options.store or Path(folder)
        store.mkdir(parents=True, exist_ok=True)
        for kind, name in SURFACES.values():
            path = store / f"{name}.npz"
            if not path.is_file():
                pair = compared(polygons(kind, name), remesh=kind == "first")
                np.savez(
                    path,
                    vertices=pair.mesh.vertices,
                    quads=pair.mesh.quads,
                    cuts=pair.cuts,
                    percent=pair.percent,
                )
        page = drawn({title: _read(store / f"{name}.npz") for title, (_, name) in SURFACES.items()})
    page.quantize(COLOURS, dither=Image.Dither.NONE).save(TARGET, optimize=True)
    print(f"{TARGET.name}  {TARGET.stat().st_size / 1e3:.0f} kB")
    return 0


def polygons(kind: str, name: str) -> PolygonMesh:
    """Return a surface of the zoo, or an object of Blender with its modifiers applied."""
    if kind == "zoo":
        return zoo.SURFACES[name].polygons()
    return from_blender(bench_first.OBJECTS[name])


def compared(surface: PolygonMesh, *, remesh: bool) -> Pair:
    """Lay a surface out, make it fit, propose layouts, and make the one that is taken fit."""
    settings, fit = Settings(), ("spirals", "optimise", "simulate")
    surface = trial.remesh_into_quads(surface, QUADS) if remesh else surface
    given = job.run_stages(job.run(surface, settings, edge=EDGE, stop_after="split"), settings, fit)
    chosen = job.run_stages(given, settings, ("choose",))
    after = chosen if chosen.design is not None else job.run_stages(chosen, settings, fit)
    cuts, percent = [], []
    for one in (given, after):
        assert one.flat is not None
        assert one.simulation is not None
        cuts.append(one.flat.layout.cut)
        percent.append(one.simulation.target_distances["rms_percent"])
    return Pair(given.mesh, np.array(cuts), np.array(percent))


def _read(path: Path) -> Pair:
    with np.load(path) as kept:
        return Pair(QuadMesh(kept["vertices"], kept["quads"]), kept["cuts"], kept["percent"])


def drawn(pairs: dict[str, Pair]) -> Image.Image:
    """Draw every surface with its two layouts below each other."""
    side = round(SIDE * raster.PIXEL_SCALE)
    tall = TITLE + 2 * (side + LINE)
    rows = -(-len(pairs) // COLUMNS)
    page = Image.new("RGB", (COLUMNS * (side + GAP) + GAP, rows * (tall + GAP)), "white")
    pen = ImageDraw.Draw(page)
    for k, (title, pair) in enumerate(pairs.items()):
        left, top = GAP + k % COLUMNS * (side + GAP), k // COLUMNS * (tall + GAP)
        _write(pen, left + side / 2, top + TITLE / 2, title, 18)
        for cut, percent in zip(pair.cuts, pair.percent, strict=True):
            layout = PatchLayout(pair.mesh, cut & ~pair.mesh.border)
            small = plots.draw_thumbnail(
                pair.mesh.vertices, pair.mesh.quads, layout.outline_sides, layout.patch_of, SIDE
            )
            picture = np.round(255 * raster.render_drawing(small, {})).astype(np.uint8)
            page.paste(Image.fromarray(picture).convert("RGB"), (left, top + TITLE))
            count = len(layout.patches)
            words = f"{count} panel{'' if count == 1 else 's'}, {percent:.2g} %"
            _write(pen, left + side / 2, top + TITLE + side + LINE / 3, words, 16)
            top += side + LINE
    return page


def _write(pen: ImageDraw.ImageDraw, x: float, y: float, words: str, size: int) -> None:
    pen.text((x, y), words, fill="black", anchor="mm", font=ImageFont.load_default(size))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
