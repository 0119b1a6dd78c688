"""The zoo: families of parametric test surfaces for the whole program.

They stand for classes: what differs within a family is what a layout, a simulation or a nesting may stumble over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh, QuadMesh

from . import irregular as ir
from . import smooth as sm


@dataclass(frozen=True)
class Surface:
    """One surface: a function that makes it, in any size, and the requirements on it.

    supports : which quads stand, as ``job.run`` takes it
    refused : the code of the finding for which the check must refuse it, if it must
    remesh : it is made of triangles; the number of quads that the remesh is to make of them
    """

    make: Callable[[], QuadMesh | PolygonMesh]
    supports: str | None = None
    refused: str | None = None
    remesh: int | None = None

    def polygons(self) -> PolygonMesh:
        """The surface as it would come from a file."""
        made = self.make()
        return PolygonMesh.from_quads(made) if isinstance(made, QuadMesh) else made


def _of(make: Callable[..., QuadMesh | PolygonMesh], *arguments: object, **options: object) -> Surface:
    return Surface(partial(make, *arguments, **options))


def _standing(make: Callable[..., QuadMesh], *arguments: object, **options: object) -> Surface:
    return Surface(partial(make, *arguments, **options), supports="lowest")


def _remeshed(count: int, make: Callable[..., PolygonMesh], *arguments: object) -> Surface:
    return Surface(partial(make, *arguments), remesh=count)


SURFACES: dict[str, Surface] = {
    # round a pole
    "cap-pole4": _of(sm.cap, 8, 5, 60),
    "cap-pole6": _of(sm.cap, 12, 7, 70),
    "cap-pole12": _of(sm.cap, 24, 12, 80),
    "cap-feet": _standing(sm.cap, 20, 12, 90),
    "cap-shallow": _of(sm.cap, 16, 8, 90, 0.25),
    "cone": _of(sm.cone, 16, 10, 1.2),
    "flower3": _of(sm.flower, 3, 24, 9, 0.4),
    "flower5": _of(sm.flower, 5, 30, 11, 0.25),
    "spindle": _of(sm.spindle, 12, 18, 2.0),
    "spindle-sharp": _of(sm.spindle, 10, 20, 2.5, 1.3),
    "globe": _of(sm.spindle, 20, 16, 1.0),
    "lens": _of(sm.spindle, 24, 14, 0.35),
    # one irregular vertex
    "star3": _of(sm.star, 3, 9, 0.5),
    "star5": _of(sm.star, 5, 8, 0.5),
    "star6-monkey": _of(sm.star, 6, 8, 0.3, "saddle"),
    "star7": _of(sm.star, 7, 7, 0.4),
    "star8-saddle": _of(sm.star, 8, 8, 0.15, "saddle"),
    "star10": _of(sm.star, 10, 7, 0.6),
    "star12": _of(sm.star, 12, 7, 0.3),
    "star12-flat-corners": _of(sm.star, 12, 7, 0.3, "dome", 50.0),
    # tubes
    "cylinder": _of(sm.cylinder, 24, 16, 4.2),
    "cylinder-slender": _of(sm.cylinder, 8, 40, 31.0),
    "cone-tube": _of(sm.cylinder, 24, 14, 2.4, 0.4),
    "bellows": _of(sm.bellows, 20, 30, 3, 0.18),
    "vase": _of(sm.vase, 24, 20),
    "tower": _of(sm.hyperboloid, 30, 16, 0.6),
    "tower-leaning": _of(sm.hyperboloid, 30, 16, 0.7, 0.6),
    "elbow": _of(sm.elbow, 16, 18),
    "coil": _of(sm.coil, 10, 60, 1.5),
    # tori, knots
    "torus-thin": _of(sm.torus, 60, 8, 0.13),
    "torus-thick": _of(sm.torus, 32, 24, 0.72),
    "torus-slip": _of(sm.torus, 36, 12, 0.4, 6),
    "torus-egg": _of(sm.torus, 36, 16, 0.35, 0, 2.0),
    "torus-large": _of(sm.torus, 90, 36, 0.45),
    "trefoil": _of(sm.knot, 2, 3, 110, 8, 0.45),
    "knot25": _of(sm.knot, 2, 5, 150, 8, 0.38),
    "knot-eight": _of(sm.figure_eight_knot, 170, 6, 0.3),
    # minimal surfaces
    "catenoid": _of(sm.catenoid, 30, 14, 1.2),
    "helicoid": _of(sm.helicoid, 40, 8, 1.2),
    "enneper": _of(sm.enneper, 18, 1.1),
    "enneper-far": _of(sm.enneper, 24, 1.5),
    "enneper-pole3": _of(sm.enneper_polar, 3, 24, 9, 0.9),
    "scherk": _of(sm.scherk, 16),
    "soap-frame2": _of(sm.soap_frame, 18, 0.5, 2),
    "soap-frame4": _of(sm.soap_frame, 20, 0.4, 4),
    "schwarz-p": _of(ir.schwarz_p, 3),
    # saddles, vaults, hills
    "hypar": _of(sm.hypar, 14, 0.6),
    "hypar-steep": _of(sm.hypar, 18, 1.4),
    "monkey": _of(sm.monkey, 18, 0.5),
    "barrel": _of(sm.barrel, 20, 16, 140, 0.25),
    "barrel-waist": _of(sm.barrel, 20, 16, 140, -0.35),
    "vault-plain": _of(sm.barrel, 16, 16, 150, 0.0),
    "saddle-aspect2": _of(sm.saddle, 12, 22, 0.45, 0.0, 2.0),
    "saddle-aspect4": _of(sm.saddle, 8, 30, 0.45, 0.0, 4.0),
    "hill-aspect3": _of(sm.cushion, 9, 26, 0.6, 0.0, 3.0),
    "saddle-shear20": _of(sm.saddle, 16, 16, 0.4, 20.0),
    "saddle-shear50": _of(sm.saddle, 16, 16, 0.5, 50.0),
    "hill-shear35": _of(sm.cushion, 16, 16, 0.8, 35.0),
    "hill-ratio2": _of(sm.graded, 18, 2.0, 0.3),
    "hill-ratio4": _of(sm.graded, 20, 4.0, 0.3),
    "hill-ratio8": _of(sm.graded, 24, 8.0, 0.3),
    "hill-ratio20": Surface(partial(sm.graded, 24, 20.0, 0.3), refused="size-ratio"),
    "terrain-gentle": _of(sm.terrain, 20, 1, 1.2, 0.15),
    "terrain-rough": _of(sm.terrain, 24, 2, 0.8, 0.16),
    "terrain-steep": _of(sm.terrain, 36, 3, 0.9, 0.3),
    "terrain-large": _of(sm.terrain, 77, 4, 0.7, 0.15),
    # domes
    "dome-level": _of(sm.cushion, 14, 14, 0.57),
    "dome-level-feet": _standing(sm.cushion, 14, 14, 0.57),
    "dome": _of(shapes.dome, 10),
    "dome-rim": _standing(shapes.dome, 10),
    "dome-feet4": _standing(ir.feet, 16, 4),
    "dome-oculus": _of(ir.oculus, 14, 25),
    "ball-band": _of(ir.oculus, 14, 45, -0.7),
    "ball-large": _of(shapes.cubesphere, 31),
    "tiny": _of(sm.cushion, 6, 5, 0.5),
    # folded, creased
    "gable": _of(ir.folded, 14, 14, 1, 0.7),
    "accordion": _of(ir.folded, 24, 12, 4, 0.25),
    "sawtooth": _of(ir.sawtooth, 5, 12, 4, 0.08),
    "miura": _of(ir.miura, 6, 5, 3, 0.5, 0.6),
    "hip-roof": _of(ir.pyramid, 16, 0.7),
    "tents": _of(ir.tents, 16, 0.6),
    "cross-vault": _standing(ir.creased_dome, 16, 0.8),
    # right angles
    "cube": _of(ir.block, "cube", 6),
    "block-l": _of(ir.block, "l", 4),
    "stairs": _of(ir.block, "stairs", 3),
    "castle": _of(ir.block, "castle", 3),
    "cross": _of(ir.block, "cross", 4),
    "box-open": _of(ir.open_box, 8, 4),
    "channel": _of(ir.channel, 20, 5),
    "tetris-round": _of(ir.rounded, "tetris", 1, 2),
    # handles, branches
    "genus0": _of(ir.handles, 0, 3),
    "genus1": _of(ir.handles, 1),
    "genus2": _of(ir.handles, 2),
    "genus4": _of(ir.handles, 4),
    "genus5-frame": _of(ir.rounded, "frame", 1, 2),
    "branch-y": _of(ir.branches, "xXZ", 1, 2),
    "branch-corner": _of(ir.branches, "xyz", 2, 1),
    "branch6": _of(ir.branches, "xXyYzZ", 1, 2),
    # perforated
    "perforated4": _of(ir.perforated, 11, 5, 0.3),
    "perforated16": _of(ir.perforated, 20, 5, 0.3),
    "perforated-tube": _of(ir.perforated_tube, 24, 16, 4),
    "perforated-flat": _of(ir.perforated, 13, 3, 0.0),
    "perforated196": _of(ir.perforated, 29, 2, 0.2),
    "perforated196-wide": _of(ir.perforated, 43, 3, 0.2),
    # strips
    "strip-single": _of(sm.wave_strip, 40, 1, 1, 0.12),
    "strip-wave": _of(sm.wave_strip, 60, 4, 2, 0.08),
    "ramp": _of(sm.ramp, 60, 4, 1.5),
    "ring-twisted": _of(sm.twisted_ring, 48, 4, 1.0),
    "knotted-strip": _of(sm.knotted_strip, 160, 3),
    "moebius": Surface(partial(sm.twisted_ring, 48, 4, 0.5), refused="non-orientable"),
    # Catmull and Clark of triangles and of polygons
    "cc-ball": _of(ir.catmull_clark, ir.ball_triangles(0), 3),
    "cc-octa": _of(ir.catmull_clark, ir.octa_triangles(0), 4),
    "cc-torus": _of(ir.catmull_clark, ir.octagon_ring(6, 4, 0.45), 2),
    "cc-random-ball": _of(ir.catmull_clark, ir.random_ball(20, 5), 2),
    "cc-potato": _of(ir.catmull_clark, ir.random_ball(30, 6), 2, ir.potato(1, 0.15)),
    "cc-random-hill": _of(ir.catmull_clark, ir.random_square(5, 7), 2, ir.hill(0.6)),
    "cc-cells-ball": _of(ir.catmull_clark, ir.random_cells(24, 8), 2),
    "cc-cells-saddle": _of(ir.catmull_clark, ir.random_patches(8, 9), 2, ir.saddled(0.4)),
    # every triangle in three quads
    "thirds-ball240": _of(ir.thirds, ir.ball_triangles(1), ir.on_ball),
    "thirds-ball960": _of(ir.thirds, ir.ball_triangles(2), ir.on_ball),
    "thirds-ball3840": _of(ir.thirds, ir.ball_triangles(3), ir.on_ball),
    "thirds-octa": _of(ir.thirds, ir.octa_triangles(2), ir.on_ball),
    "thirds-potato": _of(ir.thirds, ir.ball_triangles(2), ir.potato(2, 0.2)),
    "thirds-torus": _of(ir.thirds, ir.octagon_ring(14, 8, 0.4)),
    "thirds-hill": _of(ir.thirds, ir.random_square(9, 10), ir.hill(0.7)),
    "thirds-saddle": _of(ir.thirds, ir.random_square(8, 11), ir.saddled(0.4)),
    # quads by remeshing
    "remesh-potato": _remeshed(600, ir.rough_ball, 3, 0.2, 1.4),
    "remesh-rough": _remeshed(1200, ir.rough_ball, 4, 0.3, 0.9),
    "remesh-spiky": _remeshed(1500, ir.rough_ball, 5, 0.35, 0.6),
    "remesh-land": _remeshed(800, ir.rough_land, 6, 0.25),
}
