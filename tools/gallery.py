"""``gallery`` of tools/dev.py: some objects from target to sheets, their pictures, and the page docs/gallery.md.

Figures and pictures of every object go to out/gallery/NAME; the page is written from all that are there, so that one
object can be made anew by itself. Some minutes an object.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUT, DOCS = ROOT / "out" / "gallery", ROOT / "docs"
WIDTH = 1000  # pixels of the pictures in docs/
FILM, RATE, SECONDS = (880, 550), 8, 8.0  # pixels, frames a second and length of the film in docs/
ALIKE, BORDER = 40, 16  # what differs less from the ground's colour is ground; pixels of it that stay beside the pieces
HEAD = """# Gallery

Made by the program itself, with

    python3 tools/dev.py gallery

from shapes of its own and Blender's, 20 mm quads in sheets of 2 mm. Every picture shows the target, the assembled piece in its
simulated shape, and its panels. *Distance* is how far the
spirals' centres end from the target (root mean square, as a share of the size); *bending* compares how the surface bends at every
spiral (RMSE). Both are given for spirals from the curvature and for optimised ones. *Strain* is the largest on the arms' surface, to within
some 15 %; where it is beyond the limit, thinner arms, a larger piece or another material help. Times are rough, for a laser of
60 W.
"""


@dataclass(frozen=True)
class Item:
    """One object: a source for ``api.load``, and how it is to be made and shown."""

    title: str
    text: str
    source: str | Callable[[], Any]
    options: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    azimuth: float = 25.0
    elevation: float = 32.0
    film: bool = False


def suzanne() -> Any:
    """Blender's monkey."""
    import bpy

    bpy.ops.mesh.primitive_monkey_add()
    return bpy.context.object


ITEMS = {
    "canopy": Item(
        "Canopy",
        "The surface of the demo, standing on its three feet.",
        "shape:demo",
        {"supports": "lowest"},
        azimuth=-25.0,
        elevation=42.0,
        film=True,
    ),
    "dome": Item("Dome", "Half a ball, standing on its rim.", "shape:dome", {"supports": "lowest"}),
    "vault": Item("Vault", "A shell on four feet.", "shape:vault", {"supports": "lowest"}, elevation=28.0),
    "saddle": Item(
        "Saddle",
        "One panel, held at the middle of its four sides: a panel without seams stays flat by itself.",
        "shape:saddle",
        {"supports": "6,7,84,97,98,111,188,189"},
        azimuth=35.0,
    ),
    "torus": Item("Ring", "Curved both ways outside, like a saddle inside; free.", "shape:torus", elevation=42.0),
    "three-holes": Item("Three holes", "A solid with three holes; free.", "shape:three_holes", azimuth=18.0, elevation=48.0),
    "suzanne": Item(
        "Suzanne",
        "Blender's monkey, remeshed to about 900 quads; free.",
        suzanne,
        {"quads": 900},
        azimuth=-20.0,
        elevation=15.0,
    ),
}  # fmt: skip


def main(argv: list[str]) -> int:
    """Make the objects that are asked for, and the page from all that are there."""
    parser = argparse.ArgumentParser(prog="gallery", description="Make the objects of docs/gallery.md.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ITEMS)}; default: all")
    parser.add_argument("--page-only", action="store_true", help="make nothing, only write the page")
    wanted = parser.parse_args(argv)
    unknown = [name for name in wanted.names if name not in ITEMS]
    if unknown:
        parser.error(f"there is no {unknown[0]}; there are {', '.join(ITEMS)}")
    if not wanted.page_only:
        import flexmaps

        flexmaps.register()
        for name in wanted.names or ITEMS:
            make(name)
    page()
    return 0


def make(name: str) -> None:
    """Make one object: all stages, sheets, picture and figures."""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.hosts import job_folder
    from flexmaps.bridge.hosts.background import ConsoleProgress
    from flexmaps.bridge.view import picture
    from flexmaps.engine.params import RenderParams

    item, folder = ITEMS[name], OUT / name
    tell = ConsoleProgress(item.title)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    source = item.source if isinstance(item.source, str) else item.source()
    piece = api.load(source, edge=20, settings=item.settings, **item.options)
    piece = api.sheets(api.optimise(api.layout(piece, progress=tell), progress=tell), progress=tell)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    api.export(piece, folder, name=name)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    obj = api.show(replace(piece, uid=None))
    view = {"azimuth": item.azimuth, "elevation": item.elevation}
    shown = api.change(piece, {f"render.{key}": value for key, value in view.items()}).settings.render
    with job_folder.suppress_output():
        picture.render_together(obj, folder / "picture.png", replace(shown, pixels_x=WIDTH, samples=16))
    assert isinstance(shown, RenderParams)
    api.report(piece, folder)
    if item.film:
        film(obj, folder, shown)


def film(obj: Any, folder: Path, view: Any) -> None:
    """The assembly of an object, which is there with its simulated shape, as frames and as one file that a page can show."""
    import bpy
    import numpy as np
    from flexmaps.bridge.hosts import job_folder
    from flexmaps.bridge.view import picture
    from PIL import Image

    bpy.context.scene.render.fps = RATE
    obj.flexmaps.film.seconds = SECONDS
    bpy.context.view_layer.objects.active = obj
    bpy.ops.flexmaps.animate()
    frames = folder / "film"
    frames.mkdir()
    with job_folder.suppress_output():
        picture.render_film(obj, frames / "frame.png", replace(view, pixels_x=FILM[0], pixels_y=FILM[1], samples=8))
    pictures = np.stack([np.array(Image.open(file).convert("RGB")) for file in sorted(frames.glob("*.png"))])
    ground = np.median(pictures[0], axis=(0, 1))
    seen = (np.abs(pictures - ground) > ALIKE).any(axis=(0, 3))
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    room = [slice(max(used[0] - BORDER, 0), used[-1] + BORDER) for used in (rows, columns)]
    shown = [Image.fromarray(each[room[0], room[1]]) for each in pictures]
    durations = [1000 // RATE] * (len(shown) - 1) + [2500]
    shown[0].save(
        folder / "assembly.webp", save_all=True, append_images=shown[1:], duration=durations, loop=0, quality=75
    )


def page() -> None:
    """docs/gallery.md and its pictures, from all objects that were made; of others the page keeps what it says."""
    from PIL import Image

    pictures = DOCS / "images" / "gallery"
    pictures.mkdir(parents=True, exist_ok=True)
    for made in OUT.glob("*/assembly.webp"):
        shutil.copyfile(made, DOCS / "images" / "assembly.webp")
    there = DOCS / "gallery.md"
    known = there.read_text(encoding="utf-8").split("\n## ") if there.is_file() else []
    earlier = {section.splitlines()[0]: f"## {section}".rstrip() + "\n" for section in known[1:]}
    parts = [HEAD]
    for name, item in ITEMS.items():
        report = OUT / name / "report.json"
        if not report.is_file():
            print(f"{name} was not made; the page keeps what it says of it")
            parts += [earlier[item.title]] if item.title in earlier else []
            continue
        Image.open(OUT / name / "picture.png").convert("RGB").save(pictures / f"{name}.jpg", quality=86, optimize=True)
        parts.append(_section(name, item, json.loads(report.read_text(encoding="utf-8"))))
    there.write_text("\n".join(parts), encoding="utf-8")
    print(f"{there}: {len(parts) - 1} objects")


def _section(name: str, item: Item, report: dict[str, Any]) -> str:
    size = " x ".join(f"{mm:.0f}" for mm in report["input"]["size_mm"])
    found, sheets = report["optimise"], report["sheets"]
    strain = report["equilibrium"].get("strain_share_max")
    rows = {
        "size": f"{size} mm",
        "spirals": str(report["spirals"]["count"]),
        "patches": str(report["layout"]["patches"]),
        "distance": f"{found['rms_percent_before']:.2f} % -> {found['rms_percent']:.2f} %",
        "bending": f"{found['laplacian_rmse_mm_before']:.2f} mm -> {found['laplacian_rmse_mm']:.2f} mm",
        "strain": "-" if strain is None else f"{100 * strain:.0f} % of what the material bears",
        "sheets": f"{sheets['sheets']} of {_sheet(sheets)}",
        "cut": f"{sheets['cut_length_m']:.1f} m, about {_minutes(sheets['cut_minutes'])}",
        "joints": f"{sheets['joints']}, about {_minutes(sheets['assembly_minutes'])} to join",
    }
    table = "\n".join(f"| {key} | {value} |" for key, value in rows.items())
    return (
        f"## {item.title}\n\n{item.text}\n\n![{item.title}](images/gallery/{name}.jpg)\n\n| | |\n|---|---|\n{table}\n"
    )


def _sheet(sheets: dict[str, Any]) -> str:
    width, height = sheets["sizes_mm"][0]
    return f"{width:.0f} x {height:.0f} mm"


def _minutes(minutes: float) -> str:
    return f"{max(minutes, 1):.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
