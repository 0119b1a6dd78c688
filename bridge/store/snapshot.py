"""What an object in Blender holds of a job, as the engine's result; ``scene.put`` is the way back."""

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
from ...engine.runs.result import Result
from ...engine.surface.mesh import PolygonMesh
from . import equilibrium, handles, mesh, notes, objects, settings, supports
from .surface import Surface

if TYPE_CHECKING:
    from ...engine.spirals.design import SpiralDesign


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What the stages need of an object, read on Blender's main thread: plain arrays and texts, safe in another thread.

    name : of the object; note : of the stage that made its spirals, if there is one
    chosen : whether its layout was chosen, and the spirals of ``mesh.LAST_NAMES`` are those found with it
    held : quads that are held; force : newtons on the quads; None without
    groups : quads by the names of the vertex groups that load cases speak of
    """

    name: str
    surface: Surface
    settings: ObjectSettings
    held: Int[np.ndarray, " supports"] | None = None
    force: Float[np.ndarray, "quads 3"] | None = None
    note: dict[str, Any] | None = None
    chosen: bool = False
    groups: dict[str, Int[np.ndarray, " some"]] = field(default_factory=dict)

    def result(self) -> Result:
        """The job's result as far as its stages have run. Raises ``FlexMapsError`` with the first error of the check.

        Members that are stored but cannot be used any more are in ``Result.lost``.
        """
        begun = job.begin(self.surface.polygons)
        made = replace(begun, supports=self.held, force=self.force, groups=self.groups, protected=self.protected)
        made = replace(made, wishes=Wishes.of(made.mesh, handles.wishes(self.surface)))
        try:
            flat = mesh.current_flat(self.surface, made.mesh) if self.has_flat else None
        except FlexMapsError as error:
            return replace(made, lost={"flat": error, "design": error})
        design = None if flat is None else mesh.design_of(self.surface, flat, self.settings.spiral)
        spoilt = self.surface.spoilt
        lost = {"design": mesh.cannot_be_cut(spoilt)} if design is None and len(spoilt) else {}
        last = mesh.last_spirals(self.surface) if self.chosen else None
        start = None if flat is None or last is None else (flat, *last)
        return replace(made, flat=flat, start=start, design=self._marked(design), lost=lost)

    def _marked(self, design: SpiralDesign | None) -> SpiralDesign | None:
        """Spirals as they are stored, and whether somebody painted them."""
        return None if design is None else replace(design, painted=bool((self.note or {}).get("painted")))

    @property
    def protected(self) -> Int[np.ndarray, " kept"] | None:
        """The quads whose spirals are protected; None where there are none."""
        marked = self.surface.values.get("protect")
        return None if marked is None or not marked.any() else np.flatnonzero(marked)

    @property
    def has_flat(self) -> bool:
        """Whether flat patches were ever written."""
        return self.surface.values.keys() >= set(mesh.FLAT_NAMES)

    def seams(self, made: Result) -> Bool[np.ndarray, " edges"]:
        """Where the object has seams, in the engine's order of edges."""
        return mesh.layout_of(self.surface, made.mesh).cut

    def start(self, made: Result) -> Result:
        """The result with spirals to go on from: fitted to settings and patches that were changed since they were made."""
        if made.flat is None:
            return made
        design = mesh.start_of(self.surface, made.flat, self.settings.spiral, self.note)
        return replace(made, design=self._marked(design))


@dataclass(frozen=True, eq=False)
class Stored:
    """Of an object: its surface, its settings, and how far the stages have come.

    uid : Blender's id of the object; None where what is seen is not its own mesh, but what modifiers made of it
    result : None where the check finds errors
    seams : the edges, in the engine's order, where the object has seams
    """

    source: PolygonMesh
    settings: ObjectSettings
    uid: int | None = None
    result: Result | None = None
    seams: Bool[np.ndarray, " edges"] | None = None


def take(obj: bpy.types.Object, surface: Surface, used: ObjectSettings, *, loaded: bool = True) -> Snapshot:
    """Read what the stages need of an object, with supports and forces if ``loaded``; takes milliseconds.

    Raises ``FlexMapsError`` where those are no groups of the object, or hold no quad.
    """
    blocks = notes.read(obj.data)
    snapshot = Snapshot(obj.name, surface, used, note=blocks.get("spirals"), chosen="choose" in blocks)
    if not loaded:
        return snapshot
    held, force = supports.loads(obj, surface, used.loads)
    return replace(snapshot, held=held, force=force, groups=supports.named(obj, surface, used.structure))


def read(obj: bpy.types.Object) -> Stored:
    """What an object holds; raises ``FlexMapsError`` where it is no mesh that FlexMaps can work on."""
    scene = bpy.context.scene
    used = settings.read(obj.flexmaps, ObjectSettings) if hasattr(obj, "flexmaps") else ObjectSettings()
    problem = objects.unusable(obj)
    if problem:
        raise FlexMapsError(problem)
    if objects.changed_by_modifiers(obj):
        return Stored(mesh.read_evaluated(obj, scene), used)
    surface = mesh.read_surface(obj, scene)
    snapshot = take(obj, surface, used, loaded=False)
    try:
        result = snapshot.result()
    except FlexMapsError:
        return Stored(surface.polygons, used, surface.uid)
    held, force = supports.loads(obj, surface, used.loads)
    loaded = replace(result, supports=held, force=force, groups=supports.named(obj, surface, used.structure))
    return Stored(surface.polygons, used, surface.uid, loaded, snapshot.seams(result))


def rest_of(uid: int) -> Pose | None:
    """The pose of an object's simulation, where that is sound and up to date."""
    obj, scene = objects.find(uid), bpy.context.scene
    return equilibrium.resting(obj, scene, mesh.read_surface(obj, scene))
