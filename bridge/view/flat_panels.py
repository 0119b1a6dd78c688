"""Show the flat patches, or the panels with their spirals, beside their model in the world's xy plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ...engine import colours
from ...engine.arrays import Float, Int
from ...engine.errors import FlexMapsError
from ...engine.params import ConnectorParams, ObjectSettings
from ...engine.progress import SILENT, Progress
from ..store import stored_report
from ..store.objects import find_by_uid
from . import collection
from .curves import join_chains, make_lines, make_outlines
from .materials import assign_colours, plain_material
from .meshes import make_polygon_mesh, make_quad_mesh, set_corner_colours

if TYPE_CHECKING:
    from ...engine.display.solids import PolygonSolid
    from ...engine.fabrication.connectors.connect import Connections
    from ...engine.patches.flattening.flatten import FlatPatches
    from ...engine.spirals.curves.arcs import Curve
    from ...engine.spirals.design import SpiralDesign
    from ..store.surface import ObjectSurface

FINGERPRINT_KEY = "flexmaps_look"  # custom property of the panels' object: settings that its connectors were drawn with
NO_CONNECTORS = (
    "plain"  # value of FINGERPRINT_KEY for panels drawn without connectors and outlines; Export redraws them
)
# fraction of white in the filled patches below the spirals, which show the colours from afar, where the spirals' lines
# are too thin; larger is paler; chosen by eye
WHITE_SHARE = 0.35
LINE_RADIUS = (
    0.03  # radius of a drawn line, in median edge lengths; larger is easier to see and hides more; chosen by eye
)


def panels_of(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """Return the objects that show the panels of a model."""
    return collection.objects_of_kinds(obj, "panels")


def show_flat(
    obj: bpy.types.Object, scene: bpy.types.Scene, flat: FlatPatches, centres: Float[np.ndarray, "patches 2"]
) -> None:
    """Show the flat patches as one mesh, and their outlines as lines; both sides of a seam have the same colour.

    Parameters
    ----------
    obj, scene : the model and its scene
    flat : the patches
    centres : position of every patch's origin, metres
    """
    collection.clear(obj)
    edge = flat.layout.mesh.median_edge
    place = collection.layout_corner(obj, scene, 3 * edge)
    points = _points_in_space(flat, centres)
    collection.add(obj, scene, "panels", "panels", _filled_mesh(f"{obj.name} panels", flat, points), place)

    sides = flat.layout.outline_sides
    quad, side = np.nonzero(sides)
    seams = flat.layout.seam_of[flat.layout.mesh.quad_edges[quad, side]]  # -1 at the border
    pairs = flat.layout.flat_corners[quad[:, None], np.stack([side, (side + 1) % 4], axis=1)]
    runs = [(points[run], seam) for seam in np.unique(seams).tolist() for run in join_chains(pairs[seams == seam])]
    curve = make_lines(f"{obj.name} seams", [r[0] for r in runs], LINE_RADIUS * edge)
    palette = colours.seam_colours(len(flat.layout.seams))  # same colours as on the assembly sheet
    for k, colour in enumerate(palette):
        curve.materials.append(plain_material(f"FlexMaps seam {k + 1:02d}", colour))
    curve.materials.append(plain_material("FlexMaps border", colours.srgb_to_linear(colours.SEAM)))
    for spline, (_, seam) in zip(curve.splines, runs, strict=True):
        spline.material_index = seam if seam >= 0 else len(palette)
    collection.add(obj, scene, "seams", "seams", curve, place)


def _points_in_space(flat: FlatPatches, centres: Float[np.ndarray, "patches 2"]) -> Float[np.ndarray, "vertices 3"]:
    """Return the flat vertices in metres; ``centres`` are the positions of the patches' origins."""
    points = np.zeros((len(flat.points), 3))
    points[flat.layout.flat_corners, :2] = flat.corners + centres[flat.layout.patch_of][:, None]
    return points


def _filled_mesh(
    name: str, flat: FlatPatches, points: Float[np.ndarray, "vertices 3"], white: float = 0.0
) -> bpy.types.Mesh:
    """Make a mesh of the flat patches in their colours, mixed with a fraction of white (0 to 1)."""
    mesh = make_quad_mesh(name, points, flat.layout.flat_corners)
    rgb = colours.patch_colours(len(flat.layout.patches))[flat.layout.patch_of]
    rgb = white + (1.0 - white) * rgb
    set_corner_colours(mesh, np.repeat(rgb, 4, axis=0))
    assign_colours(mesh, rgb)
    return mesh


def connector_fingerprint(settings: ObjectSettings) -> str:
    """Return all settings that the drawn connectors depend on, as a text to compare."""
    return f"{settings.connect}, mill {settings.cut.mill:g}"


@dataclass(frozen=True, eq=False)
class PanelDrawing:
    """The panels of a design as solids and as exact outlines, computed and ready to be shown beside the model.

    fingerprint : settings of the connectors (from ``connector_fingerprint``), ``NO_CONNECTORS`` without connectors, or ""
        if the connectors are drawn as on the sheets
    centres : position of every panel's origin, metres
    solid : mesh of all panels
    outlines : for every panel the outer curve, then its holes, in its patch's frame
    """

    design: SpiralDesign
    fingerprint: str
    centres: Float[np.ndarray, "patches 2"]
    solid: PolygonSolid
    outlines: Sequence[Sequence[Curve]]

    @classmethod
    def from_design(cls, design: SpiralDesign, settings: ObjectSettings, progress: Progress = SILENT) -> PanelDrawing:
        """Draw the panels with connectors, as on the sheets; with plain ends if the connectors cannot be made.

        Parameters
        ----------
        design : spirals to draw
        settings : settings of the object; those of connectors, sheets and the cutter matter
        progress : called with a fraction and a text while connectors are computed; may raise to cancel
        """
        from ...engine.display import solids
        from ...engine.fabrication.connectors import connect

        tolerance = max(settings.sheet.tolerance, solids.DRAWING_TOLERANCE)
        try:
            made = connect.connect(design, settings.connect, tolerance, progress, settings.cut.mill)
        except FlexMapsError:  # Export reports the reason
            made = connect.connect(design, ConnectorParams(connector="none"), tolerance)
        return cls.from_connections(design, made, settings)

    @classmethod
    def from_connections(cls, design: SpiralDesign, connections: Connections, settings: ObjectSettings) -> PanelDrawing:
        """Draw the panels with connectors that are already computed.

        Parameters
        ----------
        design : spirals to draw
        connections : connectors and outlines of the design's panels
        settings : settings of the object
        """
        from ...engine.display import arrange, solids

        centres = arrange.arrange_patches(design.flat)
        outlines = [(o.outer, *o.holes) for o in connections.outlines]
        return cls(
            design,
            connector_fingerprint(settings),
            centres,
            solids.make_light_solids(design, centres, connections.tips),
            outlines,
        )

    @classmethod
    def without_connectors(cls, design: SpiralDesign) -> PanelDrawing:
        """Draw the panels quickly, without connectors and outlines; Export replaces this drawing."""
        from ...engine.display import arrange, solids

        centres = arrange.arrange_patches(design.flat)
        return cls(design, NO_CONNECTORS, centres, solids.make_light_solids(design, centres), [])

    def write(
        self, obj: bpy.types.Object, surface: ObjectSurface, spirals: dict[str, Any], layout: dict[str, Any] | None
    ) -> None:
        """Write the design and its report blocks into the object.

        Parameters
        ----------
        obj, surface : the object and its surface
        spirals : report block "spirals"
        layout : entries to update in the report block "layout" if the flat patches have changed, else None
        """
        from ..store import mesh

        if layout is not None:
            mesh.write_flat(obj, surface, self.design.flat, self.centres)
            stored_report.write(obj.data, "layout", stored_report.read(obj.data).get("layout", {}) | layout)
        mesh.write_design(obj, surface, self.design)
        stored_report.write(obj.data, "spirals", spirals)

    def make_mesh(self, name: str) -> bpy.types.Mesh:
        """Make the coloured mesh of all panels, in metres."""
        mesh = make_polygon_mesh(f"{name} panels", self.solid.vertices, self.solid.corners, self.solid.sizes)
        rgb, palette, of = self.colour_arrays
        set_corner_colours(mesh, rgb)
        assign_colours(mesh, palette, of)
        return mesh

    @cached_property
    def colour_arrays(
        self,
    ) -> tuple[Float[np.ndarray, "corners 3"], Float[np.ndarray, "colours 3"], Int[np.ndarray, " faces"]]:
        """Return the linear colour of every face corner, the list of colours in use, and each face's index into it."""
        layout = self.design.flat.layout
        # connectors have their seam's colour, as on the assembly sheet
        palette = np.concatenate([colours.patch_colours(len(layout.patches)), colours.seam_colours(len(layout.seams))])
        row = np.where(
            self.solid.seam_of < 0, layout.patch_of[self.solid.quad_of], len(layout.patches) + self.solid.seam_of
        )
        used = np.flatnonzero(np.bincount(row))
        return np.repeat(palette[row], self.solid.sizes, axis=0), palette[used], np.searchsorted(used, row)

    def place_mesh(
        self, obj: bpy.types.Object, scene: bpy.types.Scene, mesh: bpy.types.Mesh
    ) -> Float[np.ndarray, " 3"]:
        """Put the panels' mesh beside the model, replacing earlier panels; return its position in metres.

        Parameters
        ----------
        obj : model that the panels belong to
        scene : its scene
        mesh : mesh of the panels
        """
        collection.clear(obj)
        place = collection.layout_corner(obj, scene, 3 * self.design.flat.layout.mesh.median_edge)
        made = collection.add(obj, scene, "panels", "panels", mesh, place)
        if self.fingerprint:
            made[FINGERPRINT_KEY] = self.fingerprint
        flat = self.design.flat
        below = place - np.array([0.0, 0.0, LINE_RADIUS * flat.layout.mesh.median_edge])
        back = _filled_mesh(f"{obj.name} backs", flat, _points_in_space(flat, self.centres), WHITE_SHARE)
        shown = collection.add(obj, scene, "backs", "backs", back, below)
        shown.hide_render = shown.hide_select = True
        if self.solid.is_one_sided:  # only the upper side is modelled: add the thickness in renders
            thick = made.modifiers.new("Thickness", "SOLIDIFY")
            thick.thickness, thick.offset, thick.show_viewport = self.design.params.thickness, -1.0, False
        return place

    def show(self, obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[None]:
        """Put the panels beside the model in steps; between two steps the caller can let Blender redraw its window.

        Parameters
        ----------
        obj : model that the panels belong to
        scene : its scene

        Raises
        ------
        FlexMapsError : the model was deleted between two steps
        """
        uid = obj.session_uid
        place = self.place_mesh(obj, scene, self.make_mesh(obj.name))
        for k, curves in enumerate(self.outlines):
            yield
            obj = find_by_uid(uid)
            data = make_outlines(f"{obj.name} outline {k + 1}", curves)
            lift = np.array([*self.centres[k], 1.02 * self.design.params.thickness])
            made = collection.add(obj, scene, "outlines", f"outline {k + 1}", data, place + lift)
            made.hide_render = True
            if made.name in bpy.context.view_layer.objects:  # the user may have excluded the collection
                # hide the outlines, because thousands of black lines cover the panels from afar; the outliner's eye
                # icon shows them
                made.hide_set(True)
