"""The report of a run as one page that opens anywhere, also without a network: everything is inside it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from typing import Any

from ..display.drawing import FONT, Drawing, svg
from ..display.plots import bars
from ..params import SHOWN, ObjectSettings

Row = tuple[str, str]

STYLE = """
:root { color-scheme: light; --ink: #262b33; --grey: #6b7280; --line: #e4e7eb; --wash: #f6f7f8; --main: #1f6f82; --warn: #b45309; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); font: 15px/1.5 FONT; }
main { max-width: 1120px; margin: 0 auto; padding: 36px 28px 60px; }
h1 { font-size: 30px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 19px; margin: 44px 0 12px; padding-top: 14px; border-top: 1px solid var(--line); }
p { margin: 6px 0; } .sub { color: var(--grey); } .small { font-size: 13px; color: var(--grey); }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(300px, 1fr)); gap: 14px; margin: 22px 0; }
figure { margin: 0; } figure img, figure svg { width: 100%; height: auto; display: block; border-radius: 8px; }
.pictures .wide { grid-column: 1 / -1; }
.pictures img { border: 1px solid var(--line); } figcaption { font-size: 13px; color: var(--grey); margin-top: 5px; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(440px, 1fr)); gap: 18px 24px; }
.plots figure { border: 1px solid var(--line); border-radius: 8px; padding: 6px; }
.cards { display: flex; flex-wrap: wrap; gap: 12px; margin: 18px 0; }
.card { flex: 1 1 110px; background: var(--wash); border-radius: 8px; padding: 12px 14px; }
.card b { display: block; font-size: 21px; white-space: nowrap; font-weight: 600; line-height: 1.25; } .card span { font-size: 13px; color: var(--grey); }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 6px 10px; border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; font-size: 13px; color: var(--grey); } .wide { overflow-x: auto; }
.paper td, .paper th { text-align: right; white-space: nowrap; } .paper td:first-child, .paper th:first-child { text-align: left; }
.note { border-left: 4px solid var(--main); background: var(--wash); padding: 9px 14px; margin: 8px 0; border-radius: 0 8px 8px 0; }
.note.warn { border-color: var(--warn); background: #fdf6ec; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(330px, 1fr)); gap: 8px 36px; }
.columns + .plots { margin-top: 18px; } .columns > table:only-child { max-width: 560px; }
.columns h3 { font-size: 14px; margin: 14px 0 2px; } .columns td:last-child { text-align: right; white-space: nowrap; }
.columns td { padding: 3px 6px; font-size: 13.5px; } tr.other td { font-weight: 600; }
details summary { cursor: pointer; color: var(--main); margin: 8px 0; }
footer { margin-top: 48px; font-size: 13px; color: var(--grey); }
@media print { main { padding: 0; } h2, figure, .card { break-inside: avoid; } }
""".replace("FONT", FONT)


def page(
    described: Mapping[str, Any],
    drawings: Mapping[str, Drawing],
    pictures: Sequence[tuple[str, bytes]] = (),
    made: str = "",
) -> str:
    """The page as HTML text.

    described : the report, see ``report.build``; drawings : plots by name, see ``report_plots.drawings``
    pictures : PNG files with what they show, for the top, of more than three the first one large; made : when
    """
    title = _title(described)
    parts = [
        _head(described, title, made),
        _pictures(drawings, pictures),
        _cards(described),
        _section("At a glance", _paper_row(described, title)),
        _section("Warnings and advice", _notes(described)),
        _section(
            "Match with the target",
            _match(described)
            + _plots(drawings, ("history", "objective", "shape", "errors", "distance", "limits", "safety")),
        ),
        _section("Spirals", _spirals(described) + _plots(drawings, ("width", "twist"))),
        _section("Patches", _patches(described) + _plots(drawings, ("patches", "distortion"))),
        _section("Making it", _making(described)),
        _section("Settings", _settings(described)),
        _section("Time", _time(described)),
    ]
    body = "\n".join(part for part in parts if part)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{escape(title)} - FlexMaps</title>\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n<main>\n{body}\n"
        f"<footer>{escape(str(described.get('program', 'FlexMaps')))}{', ' + escape(made) if made else ''}. "
        f"{escape(str(described.get('machine', '')))}</footer>\n</main>\n</body>\n</html>\n"
    )


# -- the parts ---------------------------------------------------------------------------------------------------------


def _title(described: Mapping[str, Any]) -> str:
    name = str(described.get("input", {}).get("file", "FlexMaps"))
    return name.rsplit(".", 1)[0] or name


def _head(described: Mapping[str, Any], title: str, made: str) -> str:
    given = described.get("input", {})
    settings = described.get("settings", {})
    said = []
    if given:
        size = " \N{MULTIPLICATION SIGN} ".join(f"{x:.0f}" for x in given["size_mm"])
        said += [f"{given['quads']} quads of {given['edge_mm']:.3g} mm", f"{size} mm"]
        said += [f"standing on {given['supports']} quads"] if given.get("supports") else []
    material = described.get("equilibrium", {}).get("material")
    if settings:
        thick = f"{settings['spiral']['thickness']:g} mm"
        said.append(f"{material}, {thick}" if material else f"sheet of {thick}")
    line = " \N{MIDDLE DOT} ".join(said)
    return f"<h1>{escape(title)}</h1>\n<p class=sub>{escape(line)}</p>"


def _pictures(drawings: Mapping[str, Drawing], pictures: Sequence[tuple[str, bytes]]) -> str:
    shown = [
        f"<figure{' class=wide' if k == 0 and len(pictures) > 3 else ''}>"
        f'<img alt="{escape(text)}" src="data:image/png;base64,{b64encode(data).decode("ascii")}">'
        f"<figcaption>{escape(text)}</figcaption></figure>"
        for k, (text, data) in enumerate(pictures)
    ]
    if not shown:
        shown = [
            f"<figure>{svg(drawings[name])}</figure>" for name in ("surface", "patches", "shape") if name in drawings
        ]
    return f"<div class=pictures>{''.join(shown)}</div>" if shown else ""


def _cards(described: Mapping[str, Any]) -> str:
    rows: list[Row] = []
    layout, better, shape, sheets = (described.get(k, {}) for k in ("layout", "optimise", "equilibrium", "sheets"))
    if layout:
        rows.append((str(layout["patches"]), "patches"))
    if "spirals" in described:
        rows.append((str(described["spirals"]["count"]), "spirals"))
    if better:
        before, after = better["laplacian_rmse_mm_before"], better["laplacian_rmse_mm"]
        rows.append((f"{before:.3g} \N{RIGHTWARDS ARROW} {after:.3g}", "mm RMSE before and after optimising"))
    elif shape:
        rows.append((f"{shape['laplacian_rmse_mm']:.2g} mm", "RMSE"))
    if shape:
        rows.append((f"{shape['rms_percent']:.2f} %", "RMS distance, of the size"))
        if "strain_share_max" in shape:
            rows.append((f"{100 * shape['strain_share_max']:.0f} %", "largest strain, of the limit"))
    if sheets:
        rows.append((str(sheets["sheets"]), "sheet" if sheets["sheets"] == 1 else "sheets"))
        rows.append((f"{sheets['cut_length_m']:.1f} m", "of cuts"))
    cards = "".join(f"<div class=card><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in rows)
    return f"<div class=cards>{cards}</div>" if rows else ""


def _paper_row(described: Mapping[str, Any], title: str) -> str:
    """In the manner of FlexMaps table 1 (Malomo et al. 2018), with the distances that its validation tells."""
    if "spirals" not in described:
        return ""
    better, shape = described.get("optimise", {}), described.get("equilibrium", {})
    minutes = described.get("sheets", {}).get("assembly_minutes")
    size = max(described["input"]["size_mm"])
    seconds = described.get("seconds", {})
    cells: list[Row] = [
        ("Model", title),
        ("Size (mm)", f"{size:.0f}"),
        ("Spirals", str(described["spirals"]["count"])),
        ("Patches", str(described["layout"]["patches"])),
        ("Opt. (s)", f"{seconds['optimise']:.1f}" if "optimise" in seconds else "\N{EN DASH}"),
        ("Assembly (h)", "\N{EN DASH}" if not minutes else f"{minutes / 60:.1f}"),
        ("RMSE before (mm)", f"{better['laplacian_rmse_mm_before']:.3f}" if better else "\N{EN DASH}"),
        ("RMSE (mm)", f"{shape['laplacian_rmse_mm']:.3f}" if shape else "\N{EN DASH}"),
        ("RMS distance (%)", f"{shape['rms_percent']:.3f}" if shape else "\N{EN DASH}"),
        ("Max. distance (%)", f"{shape['max_percent']:.3f}" if shape else "\N{EN DASH}"),
    ]
    head = "".join(f"<th>{escape(name)}</th>" for name, _ in cells)
    row = "".join(f"<td>{escape(value)}</td>" for _, value in cells)
    return (
        f'<div class="wide paper"><table><thead><tr>{head}</tr></thead><tbody><tr>{row}</tr></tbody></table></div>'
        "<p class=small>RMSE compares how the surface bends at every spiral (Laplacian coordinates); the distances are those "
        "of the spirals' centres to the target, as a share of its diagonal. The time of assembly is a rough estimate.</p>"
    )


def _notes(described: Mapping[str, Any]) -> str:
    said: list[tuple[bool, str]] = [(True, finding["message"]) for finding in described.get("checks", ())]
    said += [(True, text) for text in described.get("layout", {}).get("remarks", ())]
    shape, sheets = described.get("equilibrium", {}), described.get("sheets", {})
    if shape:
        strain = shape.get("strain_share_max", 0.0)
        sound = shape["converged"] and not shape["locked"] and shape["negative_eigenvalues"] == 0
        said.append((not sound, shape["status"]))
        said += [(True, f["message"]) for f in shape.get("findings", ()) if f["code"] != "no-equilibrium"]
        if strain > 1.0:
            said.append(
                (True, f"Strain reaches {100 * strain:.0f} % of what the material bears: arms break or stay bent.")
            )
    better = described.get("optimise", {})
    if "end" in better:
        said.append((not better["finished"], f"How optimising ended: {better['end']}"))
    if "reach" in described:
        said.append((False, described["reach"]["advice"]))
    said += [(True, text) for text in sheets.get("warnings", ())]
    said.sort(key=lambda item: not item[0])
    return "".join(f'<div class="note{" warn" if warning else ""}">{escape(text)}</div>' for warning, text in said)


def _match(described: Mapping[str, Any]) -> str:
    shape, better = described.get("equilibrium"), described.get("optimise")
    if not shape:
        return ""
    rows: list[Row] = [
        ("RMS distance", f"{shape['rms_mm']:.3g} mm, {shape['rms_percent']:.3g} %"),
        ("Largest distance", f"{shape['max_mm']:.3g} mm, {shape['max_percent']:.3g} %"),
        ("RMSE in Laplacian coordinates", f"{shape['laplacian_rmse_mm']:.3g} mm"),
        ("Elastic energy", f"{1e3 * shape['energy']:.4g} mJ"),
    ]
    if better:
        rows += [
            ("RMS distance before", f"{better['rms_percent_before']:.3g} %"),
            ("Steps", f"{better['iterations']}, {better['rejected'] + better['unstable']} refused"),
            ("Widths and twists at a bound", f"{100 * better['at_bound']:.0f} %"),
        ]
    return _tables([rows])


def _spirals(described: Mapping[str, Any]) -> str:
    block = described.get("spirals")
    if not block:
        return ""

    def span(key: str, unit: str) -> str:
        low, mean, high = block[key]
        return f"{low:.3g} to {high:.3g}{unit}, mean {mean:.3g}"

    rows = [
        ("Width", span("width_mm", " mm")),
        ("Twist", span("twist_deg", "\N{DEGREE SIGN}")),
        ("Diameter", span("scale_mm", " mm")),
    ]
    if "slot_min_mm" in block:  # not measured where a search was stopped
        rows.append(("Narrowest slot", f"{block['slot_min_mm']:.2f} mm"))
    return _tables([rows])


def _patches(described: Mapping[str, Any]) -> str:
    block = described.get("layout")
    if not block:
        return ""
    return _tables(
        [
            [
                ("Patches", str(block["patches"])),
                ("Smallest patch", f"{block['smallest_patch']} quads"),
                ("Narrowest isthmus", f"{block['neck_min_quads']} quads"),
                ("Largest distortion", f"{block['energy_max']:.4f}, median {block['energy_median']:.4f}"),
                ("Seam mismatch", f"{100 * block['seam_mismatch_max']:.2g} % at most"),
            ]
        ]
    )


def _making(described: Mapping[str, Any]) -> str:
    block = described.get("sheets")
    if not block:
        return ""
    left: list[Row] = [
        ("Panels", str(block["panels"])),
        ("Sheets", f"{block['sheets']}, {100 * block['fill']:.0f} % filled"),
        (
            "Sheet sizes",
            ", ".join(dict.fromkeys(f"{w:.0f} \N{MULTIPLICATION SIGN} {h:.0f} mm" for w, h in block["sizes_mm"])),
        ),
        ("Length of cuts", f"{block['cut_length_m']:.1f} m"),
    ]
    left += [("Mass", f"{block['mass_g']:.0f} g")] if "mass_g" in block else []
    right: list[Row] = []
    if "cut_minutes" in block:
        right.append(
            ("Laser of 60 W, about", f"{_duration(block['cut_minutes'])} at {block['cut_speed_mm_s']:.1f} mm/s")
        )
    if "joints" in block:
        right += [("Joints", str(block["joints"])), ("Assembly, about", _duration(block["assembly_minutes"]))]
    if block.get("connectors"):
        right.append(("Connectors", str(block["connectors"])))
    right.append(("Narrowest slot, narrowest part", f"{block['slot_min_mm']:.2f} mm, {block['bridge_min_mm']:.2f} mm"))
    files = block.get("files", [])
    listed = f"<p class=small>Files: {escape(', '.join(files))}</p>" if files else ""
    return _tables([left, right]) + listed


def _duration(minutes: float) -> str:
    return f"{max(minutes, 1):.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"


def _settings(described: Mapping[str, Any]) -> str:
    """Those that differ from the defaults, then all."""
    given = described.get("settings")
    if not given:
        return ""
    others: list[Row] = []
    tables = []
    for block in fields(ObjectSettings):
        rows = []
        for f in fields(block.default_factory):  # type: ignore[arg-type, misc]
            if f.name not in given.get(block.name, {}):
                continue
            value = given[block.name][f.name]
            factor, unit = SHOWN[f.metadata["unit"]]
            default = f.default * factor if isinstance(f.default, float) else f.default
            text = _value(value, unit, {c[0]: c[1] for c in f.metadata["choices"]})
            other = abs(value - default) > 1e-6 * abs(default) if isinstance(default, float) else value != default
            rows.append(
                f"<tr{' class=other' if other else ''}><td>{escape(f.metadata['label'])}</td><td>{escape(text)}</td></tr>"
            )
            if other:
                others.append((f"{f.metadata['label']} ({block.name}.{f.name})", text))
        if rows:
            tables.append(f"<div><h3>{escape(block.name.capitalize())}</h3><table>{''.join(rows)}</table></div>")
    said = _tables([others]) if others else "<p>All settings are the defaults.</p>"
    return f"{said}<details><summary>All settings</summary><div class=columns>{''.join(tables)}</div></details>"


def _value(value: Any, unit: str, names: Mapping[str, str]) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, str):
        return names.get(value, value) or "\N{EN DASH}"
    gap = "" if unit in ("", "\N{DEGREE SIGN}") else " "
    return f"{value:.6g}{gap}{unit}"


def _time(described: Mapping[str, Any]) -> str:
    seconds = described.get("seconds", {})
    if not seconds:
        return ""
    drawn = bars([(name, value) for name, value in seconds.items()], f"{sum(seconds.values()):.1f} seconds in all", "s")
    return f"<div class=plots><figure>{svg(drawn)}</figure></div>"


# -- pieces ------------------------------------------------------------------------------------------------------------


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{body}</section>" if body else ""


def _tables(columns: Iterable[Sequence[Row]]) -> str:
    made = []
    for rows in columns:
        cells = "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in rows)
        made.append(f"<table>{cells}</table>")
    return f"<div class=columns>{''.join(made)}</div>"


def _plots(drawings: Mapping[str, Drawing], names: Iterable[str]) -> str:
    shown = "".join(f"<figure>{svg(drawings[name])}</figure>" for name in names if name in drawings)
    return f"<div class=plots>{shown}</div>" if shown else ""
