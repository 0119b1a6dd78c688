"""FlexMaps from Python: every stage as a function, for a Blender object, a mesh file, or arrays.

    try:
        from bl_ext.user_default.flexmaps import api  # in Blender, with the extension installed
    except ImportError:
        from flexmaps import api  # beside Blender as a Python module, from pip or a checkout

    piece = api.load("surface.obj", edge=20)  # quads of 20 mm
    piece = api.layout(api.regularise(piece))
    piece = api.optimise(api.spirals(piece), supports="lowest")
    print(api.report(piece)["optimise"]["laplacian_rmse_mm"])
    api.export(piece, "out/surface")

A ``Piece`` is immutable: every stage returns a new one, so that variants can be compared. A stage first runs the
earlier stages whose results are missing. Arguments use the units of the sidebar, millimetres and degrees; the arrays
inside a piece are in metres and radians. Wrong input raises ``FlexMapsError``. ``progress(fraction, text)`` may be any
function; it may raise ``Cancelled`` to stop the work.
"""

from __future__ import annotations

from ..engine.errors import Cancelled, FlexMapsError
from ..engine.extras import registry
from ..engine.params import ObjectSettings
from ..engine.runs.piece import Piece
from ..engine.surface.checking.check import Finding
from ..engine.surface.mesh import PolygonMesh, QuadMesh
from .handles import pull, wish
from .output import calibrated, calibration_sheet, export, report, run, share
from .painting import paint, protect
from .pieces import change, check, load, remesh, save, show
from .pressing import press, presses
from .steps import (
    choose,
    compare,
    explore,
    layout,
    optimise,
    regularise,
    sheets,
    simulate,
    spirals,
    structure,
    take,
    use,
)

if registry.has("calibrating"):
    from ..engine.extras.calibrating.calibrate import Calibration

__all__ = ["Calibration", "Cancelled", "Finding", "FlexMapsError", "ObjectSettings", "Piece", "PolygonMesh", "QuadMesh", "calibrated", "calibration_sheet",
           "change", "check", "choose", "compare", "explore", "export", "layout", "load", "optimise", "paint", "press", "presses", "protect", "pull", "regularise", "remesh",
           "report", "run", "save", "share", "sheets", "show", "simulate", "spirals", "structure", "take", "use", "wish"]  # fmt: skip
