"""Settings of the program, each declared once; the sidebar and the command line are generated from them."""

from .fields import SHOWN, Params, format_value, setting
from .physics import LoadParams, MaterialParams, OptimiseParams, SimulateParams
from .pictures import PageParams, PreviewParams, RenderParams
from .production import BaseParams, CostParams, CutParams, ExportParams, SheetParams
from .settings import (
    ORDERED_ACROSS_SECTIONS,
    ObjectSettings,
    Settings,
    every_setting,
    goal_values,
    refuse_crossed,
    sections,
    values_in_shown_units,
    with_values,
)
from .spiral_params import ConnectorParams, SpiralParams
from .surface_params import ChooseParams, LayoutParams, RegulariseParams, RemeshParams
