"""Write the report of a run as one self-contained HTML page, which opens without a network.

The text and style of the page are in the templates and style sheets of the folder ``page``.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from ..display import run_plots
from ..display.drawing import Drawing, to_svg
from ..display.plots import plot_bars
from ..display.run_plots import MapValues
from ..extras import registry
from ..files import NewFile
from ..params import SHOWN, ObjectSettings
from ..params import sections as all_sections
from ..progress import SILENT, Progress
from . import share_page
from .result import Result
from .stage import Stage
from .stages import OF_EXTRAS

PAGE, PLOTS = "report.html", "plots"


def draw_plots(result: Result, described: Mapping[str, Any], distortion: float) -> dict[str, Drawing]:
    """Draw the plots of a run.

    Parameters
    ----------
    result : outputs of the stages
    described : the report, see ``report.build_report``
    distortion : limit of the layout's distortion, to mark in its plot

    Returns
    -------
    drawings by name
    """
    return all_drawings(collect_values(result), described, distortion)


def all_drawings(shown: MapValues, described: Mapping[str, Any], distortion: float) -> dict[str, Drawing]:
    """Draw the plots of the main stages and of the extras.

    Parameters
    ----------
    shown, described, distortion : as for ``run_plots.make_plots``
    """
    found = run_plots.make_plots(shown, described, distortion)
    for stage in OF_EXTRAS:
        found |= registry.load(stage.code).drawings(shown, described)
    return found


def collect_values(result: Result) -> MapValues:
    """Collect the values per quad that the plots of a run show."""
    found = MapValues.from_results(result.mesh, result.flat, result.design, result.simulation, result.limits)
    more = [output.map_values() for output in result.outputs.values()]
    return replace(found, more={name: values for each in more for name, values in each.items()})


def write_page(
    described: Mapping[str, Any],
    drawn: Mapping[str, Drawing],
    out: Path,
    new: NewFile,
    pictures: Sequence[tuple[str, Path]] = (),
    progress: Progress = SILENT,
    piece: str | None = None,
) -> list[Path]:
    """Write the page, and every plot as an SVG file in a subfolder.

    Parameters
    ----------
    described : the report, see ``report.build_report``
    drawn : plots by name, see ``draw_plots``
    out : folder to write to
    new : function from a target file to the temporary path to write to, see ``files.write_all_atomically``
    pictures : captions and PNG files
    progress : called with the fraction done; may cancel
    piece : data of the 3D view, from ``page_data.to_json``; with it the page shows the piece in 3D, and ``share.html``
        is written too; None for neither

    Returns
    -------
    paths of the written files, the page first
    """
    plots = {name: to_svg(drawn[name]) for name in progress.each([*drawn], "Writing the page")}
    shown = [(text, file.read_bytes()) for text, file in pictures]
    texts = {out / PAGE: render_page(described, plots, shown, datetime.now().strftime("%Y-%m-%d %H:%M"), piece)}
    if piece is not None:
        texts[out / share_page.SHARE] = share_page.render_share_page(piece, title_of(described), described, drawn)
    texts |= {out / PLOTS / f"{name}.svg": text for name, text in plots.items()}
    for path, text in texts.items():
        new(path).write_text(text, encoding="utf-8")
    return [*texts]


def stale_files(out: Path) -> list[Path]:
    """Return the files that an earlier call of ``write_page`` may have left in a folder."""
    names = [*run_plots.PLOT_NAMES, *(name for stage in OF_EXTRAS for name in registry.load(stage.code).PLOTS)]
    return [out / PAGE, out / share_page.SHARE, *(out / PLOTS / f"{name}.svg" for name in names)]


def render_page(
    described: Mapping[str, Any],
    plots: Mapping[str, str],
    pictures: Sequence[tuple[str, bytes]] = (),
    made: str = "",
    piece: str | None = None,
) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    described : the report, see ``report.build_report``
    plots : SVG texts by name, see ``run_plots.make_plots``
    pictures : captions and contents of PNG files for the top of the page; if there are more than three, the first is
        large
    made : date and time of the report, as text
    piece : data of the 3D view, from ``page_data.to_json``; with it the page shows the piece in 3D
    """
    environment = share_page.environment()
    environment.filters["sheet_size"] = _sheet_size
    scripts = share_page.scripts() if piece is not None else []
    seconds = described.get("seconds", {})
    changed, settings = _format_settings(described.get("settings", {}))
    text = environment.get_template("report.html.j2").render(
        report=described,
        extras=_templates(described),
        piece=piece,
        scripts=scripts,
        policy=share_page.policy(scripts),
        scrolls=True,
        plots=plots,
        pictures=[(text, b64encode(data).decode("ascii")) for text, data in pictures],
        made=made,
        title=title_of(described),
        subtitle=_subtitle(described),
        notes=_collect_notes(described),
        changed=changed,
        settings=settings,
        times_plot=to_svg(plot_bars([*seconds.items()], f"{sum(seconds.values()):.1f} seconds in all", "s")),
    )
    return str(text)


def title_of(described: Mapping[str, Any]) -> str:
    """Return the name of the piece: the input file's name without the suffix."""
    name = str(described.get("input", {}).get("file", "FlexMaps"))
    return name.rsplit(".", 1)[0] or name


def _subtitle(described: Mapping[str, Any]) -> list[str]:
    source, settings = described.get("input", {}), described.get("settings", {})
    parts = []
    if source:
        size = " \N{MULTIPLICATION SIGN} ".join(f"{x:.0f}" for x in source["size_mm"])
        parts += [f"{source['quads']} quads of {source['edge_mm']:.3g} mm", f"{size} mm"]
        parts += [f"standing on {source['supports']} quads"] if source.get("supports") else []
    material = described.get("equilibrium", {}).get("material")
    if settings:
        thick = f"{settings['spiral']['thickness']:g} mm"
        parts.append(f"{material}, {thick}" if material else f"sheet of {thick}")
    return parts


def _sheet_size(size_mm: Sequence[float]) -> str:
    return "{:.0f} \N{MULTIPLICATION SIGN} {:.0f} mm".format(*size_mm)


def _described_extras(described: Mapping[str, Any]) -> list[Stage]:
    """Return the stages of extras that have a block in the report."""
    return [stage for stage in OF_EXTRAS if any(block in described for block in stage.blocks)]


def _templates(described: Mapping[str, Any]) -> list[str]:
    """Return paths, in the folder of the extras, of the templates for the extras' sections in the report."""
    return [f"{stage.code.partition('.')[0]}/report.html.j2" for stage in _described_extras(described)]


def _collect_notes(described: Mapping[str, Any]) -> list[tuple[bool, str]]:
    """Return the notes at the top of the page as (is a warning, text), warnings first."""
    notes = [(True, finding["message"]) for finding in described.get("checks", ())]
    notes += [(True, text) for text in described.get("layout", {}).get("remarks", ())]
    shape = described.get("equilibrium", {})
    if shape:
        if not shape["converged"] or shape["negative_eigenvalues"]:
            notes.append((True, shape["status"]))
        notes += [(True, f["message"]) for f in shape.get("findings", ()) if f["code"] != "no-equilibrium"]
        notes += [(False, shape["band"]["text"])] if "band" in shape else []
    better = described.get("optimise", {})
    if "end" in better:
        notes.append((not better["finished"], f"How optimising ended: {better['end']}"))
    if better.get("wish"):
        notes.append((True, better["wish"]))
    if "reach" in described:
        notes.append((False, described["reach"]["advice"]))
    notes += [(True, text) for text in described.get("sheets", {}).get("warnings", ())]
    for stage in _described_extras(described):
        notes += registry.load(stage.code).notes(described)
    return sorted(notes, key=lambda note: not note[0])


def _format_settings(
    values: Mapping[str, Any],
) -> tuple[list[tuple[str, str]], list[tuple[str, list[tuple[str, str, bool]]]]]:
    """Return the changed settings, and all settings by section, as texts for the page.

    Changed settings are (label, value); the settings of a section are (label, value, whether changed from the default).
    """
    changed, sections = [], []
    for section, kind in all_sections(ObjectSettings).items():
        lines = []
        for f in fields(kind):  # type: ignore[arg-type]
            if f.name not in values.get(section, {}):
                continue
            value = values[section][f.name]
            factor, unit = SHOWN[f.metadata["unit"]]
            default = f.default * factor if isinstance(f.default, float) else f.default
            text = _format_setting(value, unit, {c[0]: c[1] for c in f.metadata["choices"]})
            other = abs(value - default) > 1e-6 * abs(default) if isinstance(default, float) else value != default
            lines.append((f.metadata["label"], text, other))
            if other:
                changed.append((f"{f.metadata['label']} ({section}.{f.name})", text))
        if lines:
            sections.append((section.capitalize(), lines))
    return changed, sections


def _format_setting(value: Any, unit: str, names: Mapping[str, str]) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, str):
        return names.get(value, value) or "\N{EN DASH}"
    gap = "" if unit in ("", "\N{DEGREE SIGN}") else " "
    return f"{value:.6g}{gap}{unit}"
