"""Live mode and the brush on meshes of other programs, with every kind of border."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import QuadMesh
from harness import Row, at_most, note, row
from live_brush import add_piece, strokes
from live_cases import design_of_mesh, live_input, stroke
from live_followed import FollowedPiece

# of quads alone and with a border, 240 to 871 of them
NAMES = ("cmc1.obj", "0-static.off", "heart.obj", "chebyshev_sphere.obj", "six.off", "M2_eq_quad2.obj")
SHARE = 0.05  # of the spirals, in a stroke
STROKES = 3  # of which the slowest counts
BORDERS = {"stubs": "", "rim": ", with a rim", "left_out": ", arms left out"}


def measure_meshes(folder: Path, tick: float) -> Iterator[Row]:
    """The meshes that lie in the folder; those that do not are named."""
    for name in NAMES:
        path = folder / name
        if not path.is_file():
            yield note(path.stem, "not measured: the mesh is missing", "")
            continue
        errors: list[str] = []
        for border, words in BORDERS.items():
            try:
                mesh = check.as_quad_mesh(meshio.read_mesh(path))
                for part in (_live, _brush):
                    yield from part(mesh, path.stem, border, words, tick)
            except FlexMapsError as error:
                yield note(path.stem, f"refused{words}", "", {"because": str(error)[:120]})
            except Exception as error:  # counted and told, so that the others are tried too
                errors.append(f"{part.__name__[1:]}{words}: {type(error).__name__}: {error}")
        yield at_most(path.stem, "errors", 0, len(errors), {"first": errors[0][:200]} if errors else None)


def _live(mesh: QuadMesh, name: str, border: str, words: str, _tick: float) -> Iterator[Row]:
    """Strokes that the shape follows."""
    _, made = design_of_mesh(mesh, border)
    piece, rng = FollowedPiece(live_input(made)), np.random.default_rng(1)
    followed = [piece.follow(stroke(piece.given, rng, SHARE)) for _ in range(STROKES)]
    slowest, came = max(rest for _, rest, _ in followed), sum(shape.converged for *_, shape in followed)
    yield note(name, f"live: {len(mesh.quads)} spirals at rest, s{words}", float(f"{slowest:.3g}"))
    yield row(name, f"live: strokes that came to rest{words}", f"{STROKES}", came, came == STROKES)


def _brush(mesh: QuadMesh, name: str, border: str, words: str, tick: float) -> Iterator[Row]:
    """Painting, and how long it holds up the window at the most."""
    held = strokes(add_piece(mesh, border), SHARE, STROKES)
    slowest = max(*held.dabs, *held.written, *held.undone)
    yield at_most(name, f"brush: main thread, slowest, s{words}", tick, slowest)
