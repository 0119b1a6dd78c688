"""Benchmark of live mode: how soon a piece follows a change, and whether it still does so after long work.

``changes``: processor time from a change to the first moved picture and to rest, the way to the process beside Blender included.
``surfaces``: strokes on the zoo, and how far the live shape at rest is from a simulation's. ``brush``: how long painting holds up the window.
``wishes``: how much nearer Optimise brings spirals to where they are wished. ``foreign``: live mode and the brush on meshes of other
origin beside the checkout. ``hand``: random work in Blender as a module with the process beside it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.live.live_input import LiveInput
from flexmaps.engine.extras.live.session import forget_pieces
from flexmaps.engine.materials import find_material
from flexmaps.engine.mechanics.loads import parse_supports
from flexmaps.engine.patches.layout import PatchLayout
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from harness import MESHES, Bench, Options, Rows, at_least, at_most, temporary_folder
from live_brush import measure_strokes
from live_cases import design_of_mesh, live_input, stroke
from live_followed import FollowedPiece, distance
from live_foreign import measure_meshes
from live_hand import Hand
from live_wishes import measure_wishes
from zoo import SURFACES

# number of spirals, required seconds to the first picture and to equilibrium
SIZES = ((400, 0.060, 0.2), (1000, 0.150, 0.5), (2400, 0.350, 1.2))
TICK = 0.030  # largest time on the main thread, seconds
SHARE = 0.05  # share of the spirals in a stroke
STROKES = 8  # number of strokes whose median is reported
AWAY = 0.01  # largest distance of the live shape from a simulation, millimetres
TRIES = 3  # strokes on every surface of the zoo
GROWTH = 0.05  # of the memory over the second half of the hand's work


def changes(_: Options) -> Rows:
    """Measure strokes and other changes on domes of three sizes."""
    rng = np.random.default_rng(0)
    for count, first_asked, rest_asked in SIZES:
        flat, made = design_of_mesh(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))
        name, piece = f"dome {len(made.width)}", FollowedPiece(live_input(made))
        firsts, rests, at_rest = zip(*(piece.follow(stroke(piece.given, rng)) for _ in range(STROKES)), strict=True)
        yield at_most(name, "stroke of 5 %: first picture, s", first_asked, float(np.median(firsts)))
        yield at_most(name, "stroke of 5 %: at rest, s", rest_asked, float(np.median(rests)))
        yield at_least(name, "strokes that came to rest", STROKES, sum(shape.converged for shape in at_rest))
        for what, change in others(flat.layout.mesh).items():
            first, rest, shape = piece.follow(change(piece.given))
            peer = {"at rest, s": f"{rest:.3g}", "converged": shape.converged}
            yield at_most(name, f"{what}: first picture, s", first_asked, first, peer)
    forget_pieces()


def others(mesh: Any) -> dict[str, Callable[[LiveInput], LiveInput]]:
    """Return changes of other kinds."""
    return {
        "thickness": lambda g: replace(g, spiral=replace(g.spiral, thickness=1.2 * g.spiral.thickness)),
        "material": lambda g: replace(g, material=find_material("pla")),
        "supports": lambda g: replace(g, supports=parse_supports(mesh, "lowest")),
        "gravity": lambda g: replace(g, simulate=replace(g.simulate, gravity=True)),
        "vertices of the target pulled": pull_vertices,
        "a seam cleared": lambda g: replace(g, seams=clear_seam(g, mesh)),
    }


def pull_vertices(given: LiveInput) -> LiveInput:
    away = np.linalg.norm(given.vertices - given.vertices[len(given.vertices) // 3], axis=1)
    shift = 0.005 * np.exp(-((away / 0.04) ** 2))[:, None] * [0.0, 0.0, 1.0]
    return replace(given, vertices=given.vertices + shift)


def clear_seam(given: LiveInput, mesh: Any) -> np.ndarray:
    """Return the seams without those between two of the patches."""
    layout, seams = PatchLayout(mesh, given.seams), given.seams.copy()
    sides = np.sort(layout.patch_of[mesh.edge_quads], axis=1)
    between = seams & (sides[:, 0] != sides[:, 1]) & ~mesh.border
    seams[between & (sides == sides[between][0]).all(axis=1)] = False
    return seams


def surfaces(options: Options) -> Rows:
    """Measure strokes on surfaces of the zoo, to which nothing was tuned."""
    rng, found = np.random.default_rng(1), []
    for made in islice(_pieces(), options.surfaces):
        piece = FollowedPiece(live_input(made))
        for _ in range(TRIES):
            _, rest, shape = piece.follow(stroke(piece.given, rng))
            if shape.converged:
                found.append((rest * 1000.0 / len(made.width), distance(piece.given, made, shape)))
    slow, away = zip(*found, strict=True)
    slowest = {"slowest": f"{max(slow):.3g}", "strokes that found rest": len(slow)}
    yield at_most("zoo", "at rest, s for 1,000 spirals, median", 0.5, float(np.median(slow)), slowest)
    yield at_most("zoo", "mm from a simulation begun there, worst", AWAY, max(away))
    forget_pieces()


def _pieces() -> Iterator[Any]:
    """Yield the spirals of surfaces of the zoo that can be made."""
    for surface in SURFACES.values():
        if not (surface.refused or surface.remesh):
            try:
                yield design_of_mesh(check.as_quad_mesh(surface.polygons()))[1]
            except FlexMapsError:
                continue


def hand(options: Options) -> Rows:
    """Work on an object at random while live mode follows."""
    with temporary_folder() as folder:
        worked = Hand(folder)
        end, memory = time.monotonic() + 60.0 * options.minutes, []
        while time.monotonic() < end:
            worked.act()
            memory.append((resident_bytes("self"), resident_bytes(str(worked.process))))
        name = f"{len(worked.obj.data.polygons)} spirals"
        first = {"first": worked.errors[0][:200]} if worked.errors else {}
        yield at_most(name, "errors", 0, len(worked.errors), {"acts": dict(sorted(worked.done.items())), **first})
        yield at_most(name, "lost states", 0, worked.lost)
        yield at_most(name, "main thread, slowest tick, s of processor", TICK, worked.slowest)
        # after a first half, in which undo steps and kept shapes fill up
        later = np.array(memory[len(memory) // 2 :])
        early, late = (np.median(part, axis=0) for part in (later[: len(later) // 4 + 1], later[-len(later) // 4 :]))
        for who, growth in zip(("Blender", "the process beside it"), late / early - 1.0, strict=True):
            if np.isfinite(growth):
                yield at_most(name, f"memory of {who}: growth over the second half", GROWTH, float(growth))
        worked.close()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def resident_bytes(process: str) -> float:
    """Return the resident memory of a process in bytes; not a number where the system does not report it."""
    try:
        return float(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return float("nan")


PARTS: dict[str, Callable[[Options], Rows]] = {
    "changes": changes,
    "surfaces": surfaces,
    "brush": lambda _: (row for count, *_ in SIZES for row in measure_strokes(count, SHARE, TICK)),
    "wishes": lambda _: measure_wishes(),
    "foreign": lambda _: measure_meshes(MESHES / "foreign", TICK),
    "hand": hand,
}
main = Bench(
    "live", PARTS, minutes=(10.0, "how long the hand works"),
    surfaces=(24, "surfaces of the zoo at the most"),
)  # fmt: skip
