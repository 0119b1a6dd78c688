"""The piece that scripts and the command line pass from stage to stage: surface, settings and outputs of the stages."""

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
    """A surface with its settings and the outputs of the stages so far.

    source : the input polygons, metres, z up
    edge, height : requested median edge length and extent along z, metres; None for no request
    made : outputs of the stages; None if the mesh has errors
    uid : Blender's session id of the object that the piece was read from, and in which it can be shown
    seams : (E,) bool, edges marked as seams in the object
    files : files read for the piece, which are never overwritten
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
        """The outputs of the stages. Raises ``FlexMapsError`` with the first error of the mesh if there is one."""
        if self.made is None:
            checking.as_quad_mesh(self.source, checking.all_findings(self.source))
            raise FlexMapsError(f"{self.name} was not checked; load it again")
        return self.made

    @property
    def mesh(self) -> QuadMesh:
        """The quad mesh, metres."""
        return self.result.mesh
