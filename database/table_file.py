"""Making the file that ships: nodes of the table, coefficients, held-out errors, provenance."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import scipy

from ..engine.arrays import Float
from ..engine.mechanics.arms import stiffness
from ..engine.progress import SILENT, Progress
from . import table
from .geometry import Spiral


def compute(folder: Path, progress: Progress = SILENT, target: Path = stiffness.TABLE) -> dict[str, float]:
    """Compute what is missing of the nodes under ``folder``, write the table, and judge it at held-out spirals."""
    values = table.nodes(folder, table.COUNTS, progress.part(0.0, 0.9))
    about = {
        "nodes": list(table.COUNTS),
        "axes": ["ln(s/w)", "ln(w/h)", "twist / limit(s/w)", "Poisson's ratio"],
        "units": "lengths in arm widths, forces in Young's modulus times squared arm width",
        "fillet": 0.04,
        "versions": {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__},
    }
    table.write(values, target, about)
    found = judge(folder, progress.part(0.9, 1.0), target)
    table.write(values, target, {**about, "held_out": found, "held_out_seed": table.HELD_OUT_SEED})
    return found


def judge(folder: Path, progress: Progress = SILENT, target: Path = stiffness.TABLE) -> dict[str, float]:
    """Relative errors of the table's compliance at held-out spirals, whose values are kept in ``folder``."""
    compliance = np.abs(errors(table.held_out(), folder, f"held-out-{table.HELD_OUT_SEED}", progress, target))
    return {
        "spirals": len(compliance),
        "compliance_median": float(np.median(compliance)),
        "compliance_95": float(np.quantile(compliance, 0.95)),
        "compliance_worst": float(compliance.max()),
    }


def errors(
    spirals: list[tuple[Spiral, float]],
    folder: Path,
    label: str,
    progress: Progress = SILENT,
    target: Path = stiffness.TABLE,
) -> Float[np.ndarray, "n 6"]:
    """Relative errors of the compliance's eigenvalues, against finite elements.

    spirals : with their Poisson's ratios; what was solved is kept in ``folder`` under the label
    """
    found = []
    for k, (spiral, poisson) in enumerate(spirals):
        progress(k / len(spirals), f"spiral {k + 1} of {len(spirals)}")
        name = folder / f"{label}-{table.NODE_VERSION}-{k}-{table.digest(table.fineness_of(spiral))}.npy"
        if not name.is_file():
            np.save(name, table.arm(spiral, poisson)[0])
        true, made = np.load(name), stiffness.load_table(poisson, target)
        found.append(table.block_errors(true, spiral, poisson, made))
    return np.array(found)
