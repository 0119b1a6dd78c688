"""A surface with its settings and all that was made of it: what scripts and the command line hand from stage to stage."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import Bool
from ..errors import FlexMapsError
from ..params import ObjectSettings
from ..surface.checking import check as checking
from ..surface.mesh import PolygonMesh, QuadMesh
from .result import Result


@dataclass(frozen=True, eq=False)
class Piece:
    """A surface with its settings and everything that the stages have made of it so far.

    source : the polygons as they came, metres, z up; edge, height : the size that was asked for, metres
    made : what the stages made (``Result``); None where the mesh is none that can be made
    uid : Blender's id of the object that it was read from and can be shown in again
    seams : (E,) bool, edges that the object has marked as seams
    files : what it was read from, and what was read for it since: never to be written over
    """

    name: str
    source: PolygonMesh
    settings: ObjectSettings
    edge: float | None = None
    height: float | None = None
    made: Result | None = None
    uid: int | None = None
    seams: Bool[np.ndarray, " edges"] | None = None
    files: tuple[Path, ...] = ()

    @property
    def result(self) -> Result:
        """What the stages made; raises ``FlexMapsError`` with the first fault where the mesh is none that can be made."""
        if self.made is None:
            checking.as_quad_mesh(self.source, checking.everything(self.source))
            raise FlexMapsError(f"{self.name} was not checked; load it again")
        return self.made

    @property
    def mesh(self) -> QuadMesh:
        """The quads, metres."""
        return self.result.mesh
