"""Benchmark of live mode: how soon a piece follows a change, and whether it still does so after long work.

python3 tools/dev.py bench live [--minutes 1] [--surfaces 8] [--json FILE] [--only changes,surfaces,brush,wishes,foreign,hand]

``changes``: processor time of all that is done from a change to the first moved picture and to rest, reading the object, the way to
the process beside Blender, steps and drawing included, of 5 % of the spirals and of other changes. ``surfaces``: the same strokes on surfaces
of the zoo, and how far the live shape at rest is from a simulation's. ``brush``: how long painting holds up Blender's window.
``wishes``: how much nearer Optimise brings spirals to where they are wished. ``foreign``: live mode and the brush, with a rim too, on meshes of
other origin beside the checkout. ``hand``: random strokes, settings, supports, seams, undo, redo, saves and
modes in Blender as a module with the process beside it.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras.live.given import LiveInput
from flexmaps.engine.extras.live.session import forget_pieces
from flexmaps.engine.materials import material
from flexmaps.engine.mechanics.loads import parse_supports
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.checking import check
from harness import MESHES, Bench
from live_cases import given_of, of_mesh, stroke
from live_followed import Followed, distance
from rows import Row, at_most, note, row
from zoo import SURFACES

# number of spirals, required seconds to the first picture and to equilibrium
SIZES = ((400, 0.060, 0.2), (1000, 0.150, 0.5), (2400, 0.350, 1.2))
TICK = 0.030  # largest time on the main thread, seconds
SHARE = 0.05  # share of the spirals in a stroke
STROKES = 8  # number of strokes whose median is reported
AWAY = 0.01  # largest distance of the live shape from a simulation, millimetres


def main(arguments: list[str]) -> int:
    """Measure, print the table and write the rows; return 0 whatever the figures."""
    minutes, count = (10.0, "how long the hand works"), (24, "surfaces of the zoo at the most")
    bench = Bench("live", arguments, 44, only="*", minutes=minutes, surfaces=count)
    return bench.run({part.__name__: part for part in (changes, surfaces, brush, wishes, foreign, hand)})


# -- how soon --------------------------------------------------------------------------------------------------------------


def changes(_: argparse.Namespace) -> Iterator[Row]:
    """Measure strokes and other changes on domes of three sizes."""
    rng = np.random.default_rng(0)
    for count, first_asked, rest_asked in SIZES:
        flat, made = of_mesh(shapes.dome(2 * round(0.5 * np.sqrt(count / 3.0))))
        name, piece = f"dome {len(made.width)}", Followed(given_of(made))
        strokes = [piece.follow(stroke(piece.given, rng)) for _ in range(STROKES)]
        first, rest = (float(np.median([one[k] for one in strokes])) for k in range(2))
        yield at_most(name, "stroke of 5 %: first picture, s", first_asked, first)
        yield at_most(name, "stroke of 5 %: at rest, s", rest_asked, rest)
        rested = sum(one[2].converged for one in strokes)
        yield row(name, "strokes that came to rest", f"{STROKES}", rested, rested == STROKES)
        for what, wanted in others(flat.layout.mesh):
            first, rest, shape = piece.follow(wanted(piece.given))
            yield at_most(name, f"{what}: first picture, s", first_asked, first)
            yield row(name, f"{what}: at rest, s", "", float(f"{rest:.3g}"), shape.converged or None)
    forget_pieces()


def others(mesh: Any) -> Iterator[tuple[str, Callable[[LiveInput], LiveInput]]]:
    """Yield changes of other kinds."""
    yield "thickness", lambda g: replace(g, spiral=replace(g.spiral, thickness=1.2 * g.spiral.thickness))
    yield "material", lambda g: replace(g, material=material("pla"))
    yield "supports", lambda g: replace(g, supports=parse_supports(mesh, "lowest"))
    yield "gravity", lambda g: replace(g, simulate=replace(g.simulate, gravity=True))
    yield "vertices of the target pulled", pull_vertices
    yield "a seam cleared", lambda g: replace(g, seams=clear_seam(g, mesh))


def pull_vertices(given: LiveInput) -> LiveInput:
    away = np.linalg.norm(given.vertices - given.vertices[len(given.vertices) // 3], axis=1)
    shift = 0.005 * np.exp(-((away / 0.04) ** 2))[:, None] * [0.0, 0.0, 1.0]
    return replace(given, vertices=given.vertices + shift)


def clear_seam(given: LiveInput, mesh: Any) -> np.ndarray:
    """Return the seams without those between two of the patches."""
    from flexmaps.engine.patches.layout import PatchLayout

    layout, seams = PatchLayout(mesh, given.seams), given.seams.copy()
    sides = np.sort(layout.patch_of[mesh.edge_quads], axis=1)
    between = seams & (sides[:, 0] != sides[:, 1]) & ~mesh.border
    seams[between & (sides == sides[between][0]).all(axis=1)] = False
    return seams


def surfaces(options: argparse.Namespace) -> Iterator[Row]:
    """Measure strokes on surfaces of the zoo, to which nothing was tuned."""
    rng, away, slow, count, lost = np.random.default_rng(1), [], [], 0, 0
    for name, surface in SURFACES.items():
        if count == options.surfaces:
            break
        if surface.refused or surface.remesh:
            continue
        try:
            _, made = of_mesh(check.as_quad_mesh(surface.polygons()))
            piece = Followed(given_of(made))
        except FlexMapsError:
            continue
        count += 1
        for _ in range(3):
            _, rest, shape = piece.follow(stroke(piece.given, rng))
            if not shape.converged:
                lost += 1
                continue
            slow.append(rest * 1000.0 / len(made.width))
            away.append(distance(piece.given, made, shape))
        yield note(name, f"{len(made.width)} spirals: stroke at rest, s", float(f"{rest:.3g}"))
    yield note("zoo", "surfaces, strokes", f"{count}, {len(slow) + lost}")
    yield at_most("zoo", "strokes that found no rest", None, lost)
    yield at_most("zoo", "at rest, s for 1,000 spirals, median", 0.5, float(np.median(slow)))
    yield at_most("zoo", "at rest, s for 1,000 spirals, slowest", None, float(np.max(slow)))
    yield at_most("zoo", "mm from a simulation begun there, worst", AWAY, float(np.max(away)))
    forget_pieces()


def brush(_: argparse.Namespace) -> Iterator[Row]:
    """Painting on domes of three sizes."""
    from live_brush import painted

    for count, _first, _rest in SIZES:
        yield from painted(count, SHARE, TICK)


def wishes(_: argparse.Namespace) -> Iterator[Row]:
    """Measure wishes that cannot be met by rotating the whole piece."""
    from live_wishes import wished

    yield from wished()


def foreign(_: argparse.Namespace) -> Iterator[Row]:
    """Measure surfaces whose quads come from other programs."""
    from live_foreign import tried

    yield from tried(MESHES / "foreign", TICK)


# -- whether it goes on ----------------------------------------------------------------------------------------------------


def hand(options: argparse.Namespace) -> Iterator[Row]:
    """Work on an object at random while live mode follows."""
    import bpy
    from live_hand import Hand

    with tempfile.TemporaryDirectory() as folder:
        worked = Hand(Path(folder))
        end, memory = time.monotonic() + 60.0 * options.minutes, []
        while time.monotonic() < end:
            worked.act()
            memory.append((resident_bytes("self"), resident_bytes(str(worked.process))))
        name, acts = f"{len(worked.obj.data.polygons)} spirals", sorted(worked.done.items())
        yield note(name, "acts of the hand, by kind", ", ".join(f"{count} {kind}" for kind, count in acts))
        first = {"first": worked.errors[0][:200]} if worked.errors else None
        yield at_most(name, "errors", 0, len(worked.errors), first)
        yield at_most(name, "lost states", 0, worked.lost)
        yield at_most(name, "main thread, slowest tick, s of processor", TICK, worked.slowest)
        # after a first half, in which undo steps and kept shapes fill up
        later = np.array(memory[len(memory) // 2 :])
        early, late = (np.median(part, axis=0) for part in (later[: len(later) // 4 + 1], later[-len(later) // 4 :]))
        for who, growth in zip(("Blender", "the process beside it"), late / early - 1.0, strict=True):
            yield at_most(name, f"memory of {who}: growth over the second half", 0.05, float(growth))
        worked.close()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)


def resident_bytes(process: str) -> float:
    """Return the resident memory of a process in bytes; where the system does not report it, this process's peak."""
    try:
        return float(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
