"""Read everything stored on a Blender object as the engine's ``Result``; ``scene.write_result`` writes it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine.arrays import Bool, Float, Int
from ...engine.errors import FlexMapsError
from ...engine.mechanics.assembly import Pose
from ...engine.optimisation.wishes import Wishes
from ...engine.params import ObjectSettings
from ...engine.runs import job
from ...engine.runs.manual_changes import with_design
from ...engine.runs.outputs import FinalLayout, provenance
from ...engine.runs.result import Result
from ...engine.runs.stages import CHOSEN, STORED
from ...engine.surface.mesh import PolygonMesh
from . import equilibrium, handles, mesh, objects, settings, stored_report, supports
from .surface import ObjectSurface

if TYPE_CHECKING:
    from ...engine.spirals.design import SpiralDesign


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Input of the stages, read on Blender's main thread as plain arrays and texts, which other threads may read.

    name : name of the object
    surface, settings : its surface and settings
    supports : indices of the held quads, or None
    force : forces on the quads, newtons in world axes, or None
    spirals_block : report block of the stage that made its spirals, or None
    is_layout_chosen : whether Choose made the layout; then ``mesh.LAST_NAMES`` hold the spirals of its search
    groups : name -> quads, for the vertex groups that load cases use
    """

    name: str
    surface: ObjectSurface
    settings: ObjectSettings
    supports: Int[np.ndarray, " supports"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    spirals_block: dict[str, Any] | None = None
    is_layout_chosen: bool = False
    groups: dict[str, Int[np.ndarray, " some"]] = field(default_factory=dict)

    def to_result(self) -> Result:
        """Return the engine's result with the outputs of the stages that have run.

        ``Result.lost`` holds the outputs that are stored but cannot be used, with an error that says why.

        Raises
        ------
        FlexMapsError with the first error of the mesh check.
        """
        initial = job.check_input(self.surface.polygons)
        made = initial.with_user(
            supports=self.supports,
            force=self.force,
            groups=self.groups,
            protected=self.protected_quads,
            wishes=Wishes.from_offsets(initial.mesh, handles.read_wishes(self.surface)),
        )
        try:
            flat = mesh.require_current_flat(self.surface, made.mesh) if self.has_flat else None
        except FlexMapsError as error:
            return replace(made, lost={"flat": error, "design": error})
        spoilt = self.surface.invalid_faces
        spoilt_design = {"design": mesh.uncuttable_error(spoilt)} if len(spoilt) else {}
        if flat is None:
            return replace(made, lost=spoilt_design)
        start = mesh.last_spirals(self.surface) if self.is_layout_chosen else None
        stored = provenance("split", self.settings, made.inputs("mesh"))
        made = made.with_outputs(FinalLayout(flat, CHOSEN if self.is_layout_chosen else STORED, start, **stored))
        design = mesh.read_design(self.surface, flat, self.settings.spiral)
        return replace(made, lost=spoilt_design) if design is None else self._with_stored(made, design)

    def _with_stored(self, result: Result, design: SpiralDesign) -> Result:
        """Return the result with the stored spirals, marked as painted if their report block says so."""
        painted = replace(design, is_painted=bool((self.spirals_block or {}).get("painted")))
        return with_design(result, painted, STORED, self.settings)

    @property
    def protected_quads(self) -> Int[np.ndarray, " protected"] | None:
        """Return the quads whose spirals are protected from Optimise; None where there are none."""
        marked = self.surface.values.get("protect")
        return None if marked is None or not marked.any() else np.flatnonzero(marked)

    @property
    def has_flat(self) -> bool:
        """Return whether the object holds flat patches."""
        return self.surface.values.keys() >= set(mesh.FLAT_NAMES)

    def read_seams(self, result: Result) -> Bool[np.ndarray, " edges"]:
        """Return a flag for every edge, in the engine's order: whether the object has a seam there."""
        return mesh.read_layout(self.surface, result.mesh).cut

    def with_start(self, result: Result) -> Result:
        """Return the result with initial spirals for a stage, adjusted to changed settings and patches."""
        layout = result.get(FinalLayout)
        if layout is None:
            return result
        return self._with_stored(
            result, mesh.read_start(self.surface, layout.flat, self.settings.spiral, self.spirals_block)
        )


@dataclass(frozen=True, eq=False)
class StoredPiece:
    """An object's polygons, settings and results of stages.

    source : its polygons
    settings : its settings
    uid : Blender's id of the object; None where modifiers change its mesh
    result : results of its stages; None where the mesh check finds errors or modifiers change its mesh
    seams : flag for every edge, in the engine's order: whether the object has a seam there
    """

    source: PolygonMesh
    settings: ObjectSettings
    uid: int | None = None
    result: Result | None = None
    seams: Bool[np.ndarray, " edges"] | None = None


def take_snapshot(
    obj: bpy.types.Object, surface: ObjectSurface, object_settings: ObjectSettings, *, with_loads: bool = True
) -> Snapshot:
    """Read the input of the stages from an object; takes milliseconds.

    Parameters
    ----------
    obj : the mesh object
    surface : its surface
    object_settings : its settings
    with_loads : also read supports and forces

    Raises
    ------
    FlexMapsError where a vertex group of the loads is missing or holds no quad.
    """
    blocks = stored_report.read(obj.data)
    snapshot = Snapshot(
        obj.name, surface, object_settings, spirals_block=blocks.get("spirals"), is_layout_chosen="choose" in blocks
    )
    if not with_loads:
        return snapshot
    held, force = supports.read_loads(obj, surface, object_settings.loads)
    return replace(snapshot, supports=held, force=force, groups=supports.read_groups(obj, surface, object_settings))


def read_piece(obj: bpy.types.Object) -> StoredPiece:
    """Read polygons, settings and results from an object; raise ``FlexMapsError`` if FlexMaps cannot work on it."""
    scene = bpy.context.scene
    used = settings.read(obj.flexmaps, ObjectSettings) if hasattr(obj, "flexmaps") else ObjectSettings()
    problem = objects.usage_problem(obj)
    if problem:
        raise FlexMapsError(problem)
    if objects.modifier_problem(obj):
        return StoredPiece(mesh.read_evaluated(obj, scene), used)
    surface = mesh.read_surface(obj, scene)
    snapshot = take_snapshot(obj, surface, used, with_loads=False)
    try:
        result = snapshot.to_result()
    except FlexMapsError:
        return StoredPiece(surface.polygons, used, surface.uid)
    held, force = supports.read_loads(obj, surface, used.loads)
    loaded = result.with_user(supports=held, force=force, groups=supports.read_groups(obj, surface, used))
    return StoredPiece(surface.polygons, used, surface.uid, loaded, snapshot.read_seams(result))


def read_rest_pose(uid: int) -> Pose | None:
    """Return an object's simulated pose of the hubs; None where it is not reliable or out of date."""
    obj, scene = objects.find_by_uid(uid), bpy.context.scene
    return equilibrium.read_rest_pose(obj, scene, mesh.read_surface(obj, scene))


def reread_surface(uid: int) -> tuple[bpy.types.Object, ObjectSurface]:
    """Return the object with this id and its present surface; raise the errors of ``mesh.read_surface``.

    Parameters
    ----------
    uid : ``session_uid`` of the object
    """
    obj = objects.find_by_uid(uid)
    return obj, mesh.read_surface(obj, bpy.context.scene)
