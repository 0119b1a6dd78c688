"""All settings of the program, each declared once; the sidebar and the command line are generated from them."""

from .fields import SHOWN, Params, setting, shown
from .physics import LoadParams, MaterialParams, OptimiseParams, SimulateParams
from .pictures import PageParams, PreviewParams, RenderParams
from .production import BaseParams, CostParams, CutParams, ExportParams, SheetParams
from .settings import BOUNDS, ObjectSettings, Settings, refuse_crossed, shown_values, wish, with_values
from .spirals import ConnectorParams, SpiralParams
from .surface import ChooseParams, LayoutParams, RegulariseParams, RemeshParams

__all__ = [
    "BOUNDS",
    "SHOWN",
    "BaseParams",
    "ChooseParams",
    "ConnectorParams",
    "CostParams",
    "CutParams",
    "ExportParams",
    "LayoutParams",
    "LoadParams",
    "MaterialParams",
    "ObjectSettings",
    "OptimiseParams",
    "PageParams",
    "Params",
    "PreviewParams",
    "RegulariseParams",
    "RemeshParams",
    "RenderParams",
    "Settings",
    "SheetParams",
    "SimulateParams",
    "SpiralParams",
    "refuse_crossed",
    "setting",
    "shown",
    "shown_values",
    "wish",
    "with_values",
]
