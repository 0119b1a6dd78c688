"""How well the three models predict held-out energies: numbers as JSON, scatter plots as PNG (like Fig. 7 of FlexMaps),
and a page that tells what they mean."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from . import fits, packs
from .packs import Series

TITLES = {
    "chord": "four parameters, hub to free tip",
    "pair": "four parameters, hub to hub",
    "arm": "twelve numbers, linear limit",
}
LEAST = "fitted to these samples"
LEAST_TITLE = f"{TITLES['pair']}, {LEAST}"
LAW_TITLES = {"strain": "strain-targeted loads", "newton": "forces of 1 to 5 N"}
PAGE = """# What the coarse models keep of a spiral

Written by `tools/dev.py database report`. Spirals of the region that can be cut were solved as volumes under random loads at
their tips; every tenth sample is held out, the others fit the models. A strain is the one that 99 % of the spiral's volume stays
below, an error the relative one of the elastic energy.

{solved}

{errors}

- *{chord}*: the paper's four stiffnesses, fitted where they are measured most easily.
- *{pair}*: the same four, fitted where an assembly uses them, through two arms and the joint between them. They can follow
  forces; moments as well, as in the strain-targeted loads, they cannot: *{least}* is what four numbers leave at least, whatever
  loads they are fitted to.
- *{arm}*: the stiffness of a tip against its hub, from one linear solve. This is what the simulation of assembled panels uses.
  Under forces of 1 to 5 N slender arms bend far beyond its range, and beyond what their material bears (see the strains).

Numbers of every spiral: `fit_report.json`. Predicted against true energies of nine spirals:

{pictures}
"""


def summary(all_series: list[Series]) -> dict:
    """Held-out errors per model and law, over all spirals and per spiral, and what was solved.

    "floor" is what four parameters from hub to hub leave at least, see ``fits.floor``.
    """
    out: dict = {"models": {}, "floor": {}, "spirals": [], "laws": {}}
    errors = {(s.key, model): fits.errors([s], model, s.law) for s in all_series for model in fits.MODELS}
    for law in sorted({s.law for s in all_series}):
        mine = [s for s in all_series if s.law == law]
        converged, failed = (int(sum(s.counts[k] for s in mine)) for k in ("converged", "failed"))
        solved: dict[str, float] = {"spirals": len(mine), "converged": converged, "failed": failed}
        solved["iterations_mean"] = float(sum(s.counts["iterations"] for s in mine) / max(converged + failed, 1))
        solved["in_one_step"] = 1.0 - float(sum(s.counts["stepped"] for s in mine)) / max(converged + failed, 1)
        held = np.concatenate([s.held_out.strain for s in mine])
        solved["strain_median"], solved["strain_95"] = (round(float(np.quantile(held, q)), 6) for q in (0.5, 0.95))
        out["laws"][law] = solved
        for model in fits.MODELS:
            e = np.concatenate([errors[s.key, model] for s in mine])
            if len(e):
                out["models"].setdefault(model, {})[law] = _quantiles(e)
        floor = fits.floor(all_series, "pair", law)
        if len(floor):
            out["floor"][law] = _quantiles(floor)
    for s in all_series:
        row: dict = {
            "scale_mm": 1e3 * s.subject.scale,
            "width_mm": 1e3 * s.subject.width,
            "twist_deg": float(np.degrees(s.subject.twist)),
        }
        row.update({"law": s.law, "samples": s.fitted["chord"]})
        for model in fits.MODELS:
            if len(errors[s.key, model]):
                row[model] = _quantiles(errors[s.key, model])
        out["spirals"].append(row)
    return out


def _quantiles(e: np.ndarray) -> dict[str, float | int]:
    return {"median": round(float(np.median(e)), 5), "p95": round(float(np.quantile(e, 0.95)), 5), "count": len(e)}


def write(pack: Path, folder: Path, say: Callable[[str], None]) -> dict:
    """Write fit_report.json and one scatter plot a model into ``folder``; the summary is returned."""
    all_series = packs.read(pack)
    found = summary(all_series)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fit_report.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (folder / "README.md").write_text(page(found), encoding="utf-8")
    for law, solved in found["laws"].items():
        say(f"{law}: {solved['spirals']} spirals, {solved['converged']} converged, {solved['failed']} failed")
    for title, law, e in _rows(found):
        median, high = 100 * e["median"], 100 * e["p95"]
        say(f"{title:53s} {law:7s} median {median:6.2f} %   95 % {high:6.2f} %   ({e['count']} held out)")
    for model in found["models"]:
        plot(all_series, model, folder / f"energies_{model}.png")
    say(f"written to {folder}")
    return found


def _rows(found: dict) -> list[tuple[str, str, dict]]:
    """Model's title, law and errors of every row of a summary."""
    named = [(TITLES[model], by_law) for model, by_law in found["models"].items()]
    return [(title, law, e) for title, by_law in [*named, (LEAST_TITLE, found["floor"])] for law, e in by_law.items()]


def page(found: dict) -> str:
    """The summary as a page of Markdown, beside the plots."""
    solved = [
        "| loads | spirals | samples | failed | mean Newton iterations | in one step | strain, median | 95 % |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for law, s in found["laws"].items():
        count = s["converged"] + s["failed"]
        share, steps = 100 * s["failed"] / count, s["iterations_mean"]
        solved.append(
            f"| {LAW_TITLES[law]} | {s['spirals']} | {count} | {s['failed']} ({share:.3f} %) | {steps:.1f} "
            f"| {100 * s['in_one_step']:.1f} % | {100 * s['strain_median']:.2f} % | {100 * s['strain_95']:.2f} % |"
        )
    errors = ["| model | loads | median | 95 % | held out |", "|---|---|---|---|---|"]
    for title, law, e in _rows(found):
        errors.append(
            f"| {title} | {LAW_TITLES[law]} | {100 * e['median']:.2f} % | {100 * e['p95']:.1f} % | {e['count']} |"
        )
    pictures = [f"![{TITLES[model]}](energies_{model}.png)" for model in found["models"]]
    return PAGE.format(
        solved="\n".join(solved), errors="\n".join(errors), pictures="\n\n".join(pictures), least=LEAST, **TITLES
    )


def plot(all_series: list[Series], model: str, path: Path) -> None:
    """Predicted against true energies of nine spirals, coloured by relative error, in millijoules."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullFormatter

    usable = [s for s in all_series if s.law == "strain" and s.fitted["chord"] >= fits.FEWEST]
    if not usable:
        return
    order = sorted(usable, key=lambda s: (s.subject.twist, s.subject.scale, s.subject.width))
    chosen = [order[int(k)] for k in np.unique(np.linspace(0, len(order) - 1, min(9, len(order))).round())]
    figure, axes = plt.subplots(3, 3, figsize=(10, 9.6), constrained_layout=True)
    image = None
    for axis, series in zip(axes.flat, chosen):
        made, true = fits.predicted(series, model, fits.parameters(series, model))
        unit = series.subject.youngs * series.subject.width**3 * 1e3
        error = np.abs(made / true - 1.0)
        image = axis.scatter(true * unit, made * unit, c=100 * error, s=12, cmap="turbo", vmin=0, vmax=30)
        ends = np.array([min(true.min(), made.min()), max(true.max(), made.max())]) * unit
        axis.plot(ends, ends, "k-", lw=0.6)
        axis.set_xscale("log")
        axis.set_yscale("log")
        s = series.subject
        axis.set_title(
            f"s {1e3 * s.scale:g}, w {1e3 * s.width:g} mm, {np.degrees(s.twist):.0f}°: {100 * np.median(error):.1f} %",
            fontsize=9,
        )
        axis.tick_params(labelsize=7)
        for side in (axis.xaxis, axis.yaxis):
            side.set_minor_formatter(NullFormatter())
    for axis in axes.flat[len(chosen) :]:
        axis.set_visible(False)
    figure.suptitle(f"Elastic energy of held-out samples: {TITLES[model]}")
    figure.supxlabel("finite elements" + (", linear limit of two arms in series" if model == "pair" else "") + ", mJ")
    figure.supylabel("model, mJ")
    if image is not None:
        figure.colorbar(image, ax=axes, label="relative error, %", shrink=0.6)
    figure.savefig(path, dpi=80)
    plt.close(figure)
