"""Write the calibration sheet, and compute settings of the material and the machine from its measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..bridge.store import presets, settings
from ..bridge.store.i18n import translate
from ..bridge.store.paths import resolve_folder
from ..engine.errors import FlexMapsError
from ..engine.params import ObjectSettings, with_values
from .file_writer import FileWriter
from .stage import ImmediateOperator, ObjectOperator

if TYPE_CHECKING:
    from ..engine.extras.calibrating.calibrate import Calibration, Readings

SUBFOLDER = "calibration"  # within the folder of the exported sheets


class CalibrationSheet(FileWriter, ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Write a small sheet to cut and to measure: a kerf comb, ladders of clearances, a strip to bend, two spirals to hang a weight on"""

    bl_idname = "flexmaps.calibration_sheet"
    bl_label = "Calibration sheet"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> str:
        from .. import api

        wanted = settings.read(context.object.flexmaps, ObjectSettings)
        folder = resolve_folder(wanted.export.folder) / SUBFOLDER
        written = api.calibration_sheet(folder, wanted, formats=_formats(wanted), overwrite=self.overwrite)
        return translate("{} in {}", ", ".join(path.name for path in written), folder)


def _formats(settings: ObjectSettings) -> tuple[str, ...]:
    """Return the object's export formats that the calibration sheet supports, or if there are none, the usual ones."""
    from ..engine.extras.calibrating.sheet_files import DEFAULT_FORMATS, WRITERS
    from ..engine.fabrication.writers import export

    return tuple(key for key in export.chosen_formats(settings.export) if key in WRITERS) or DEFAULT_FORMATS


def _reading_property(name: str, description: str) -> object:
    return bpy.props.StringProperty(name=name, description=description, options={"SKIP_SAVE"})


class Calibrated(ImmediateOperator, ObjectOperator, bpy.types.Operator):
    """Make kerf, clearance and stiffness out of what was measured on the calibration sheet, use them here, and keep them as a preset"""

    bl_idname = "flexmaps.calibrated"
    bl_label = "Enter measurements"

    several = "Several readings with commas between them are better than one"
    kerf_comb: _reading_property("Kerf comb (mm)", f"Gap with the squares pushed to one side. {several}")  # type: ignore[valid-type]
    clearance: _reading_property("Rung that fits (mm)", "Value of the rung whose parts snap together and hold")  # type: ignore[valid-type]
    kind: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Connectors",
        items=(("dovetail", "Dovetails", ""), ("key", "Keys", ""), ("tab", "Tabs", "")),
        description="Ladder that this rung belongs to",
    )
    thickness: _reading_property("Sheet's thickness (mm)", f"At several places. {several}")  # type: ignore[valid-type]
    strip_sag: _reading_property("Strip's sag (mm)", f"Distance by which its end sinks under the weight. {several}")  # type: ignore[valid-type]
    strip_weight: _reading_property("Strip's weight (g)", "Weight that hung on it; empty: as engraved")  # type: ignore[valid-type]
    strip_mass: _reading_property("Strip's own mass (g)", "Mass of the whole strip, for the density")  # type: ignore[valid-type]
    sag_a: _reading_property("Sag of spiral A (mm)", f"Distance by which its hub sinks under the weight. {several}")  # type: ignore[valid-type]
    sag_b: _reading_property("Sag of spiral B (mm)", f"Distance by which its hub sinks under the weight. {several}")  # type: ignore[valid-type]
    weights: _reading_property("Weights of A, B (g)", "Both weights; empty: as engraved")  # type: ignore[valid-type]
    preset: bpy.props.StringProperty(name="Keep as", description="Name of the preset; empty: none is kept")  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self, width=360)

    def run(self, context: bpy.types.Context) -> str:
        from ..engine.extras.calibrating import calibrate, coupons

        obj = context.object
        wanted = settings.read(obj.flexmaps, ObjectSettings)
        made = coupons.read_coupons(resolve_folder(wanted.export.folder) / SUBFOLDER)
        result = calibrate.calibrate(made, self._readings())
        settings.write(obj.flexmaps, with_values(wanted, result.settings))
        kept = presets.write_preset(self.preset, result.settings) if self.preset.strip() else None
        self.level = "WARNING" if result.warnings else "INFO"
        return _describe(result, kept)

    def _readings(self) -> Readings:
        from ..engine.extras.calibrating.calibrate import Readings, parse_numbers

        a, b = parse_numbers(self.sag_a), parse_numbers(self.sag_b)
        if len(a) != len(b):
            raise FlexMapsError("Give as many sags of spiral A as of spiral B")
        return Readings.from_measurements(
            kerf_comb=parse_numbers(self.kerf_comb), clearance=parse_numbers(self.clearance), kind=self.kind,
            thickness=parse_numbers(self.thickness), strip_sag=parse_numbers(self.strip_sag), strip_weight=parse_numbers(self.strip_weight),
            strip_mass=parse_numbers(self.strip_mass), spiral_sag=list(zip(a, b, strict=True)), spiral_weight=parse_numbers(self.weights),
        )  # fmt: skip


def _describe(result: Calibration, preset: Path | None) -> str:
    """Return one line about the calibrated values, the preset and the warnings."""
    rows = (
        (result.kerf, 1e3, "kerf", "mm"),
        (result.clearance, 1e3, "clearance", "mm"),
        (result.youngs, 1e-9, "Young's modulus", "GPa"),
    )
    parts = [
        f"{translate(name)} {one.value * factor:.3g} {unit} \N{PLUS-MINUS SIGN} {one.error * factor:.2g}"
        for one, factor, name, unit in rows
        if one is not None
    ]
    parts += [] if preset is None else [translate("kept as preset {}", preset.stem)]
    return ". ".join([", ".join(parts), *result.warnings])


CLASSES = (CalibrationSheet, Calibrated)
