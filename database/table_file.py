"""Making the file that ships: nodes of the table, coefficients, held-out errors, provenance."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import scipy

from ..engine.mechanics import stiffness
from ..engine.progress import SILENT, Progress
from . import table


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
    """Relative errors of the table's compliance and strains at held-out spirals, whose values are kept in ``folder``."""
    compliance, strains = [], []
    spirals = table.held_out()
    for k, (spiral, poisson) in enumerate(spirals):
        progress(k / len(spirals), f"held-out spiral {k + 1} of {len(spirals)}")
        name = (
            folder
            / f"held-out-{table.NODE_VERSION}-{table.HELD_OUT_SEED}-{k}-{table.digest(table.fineness_of(spiral))}.npy"
        )
        if not name.is_file():
            np.save(name, table.arm(spiral, poisson)[0])
        true, made = np.load(name), stiffness.load_table(poisson, target)
        compliance.append(np.abs(table.block_errors(true, spiral, poisson, made)))
        ratio, flatness, twist = (np.array([v]) for v in (spiral.scale, 1.0 / spiral.height, spiral.twist))
        strains.append(np.abs(np.exp(stiffness.log_strains(ratio, flatness, twist, made)[:, 0] - true[12:]) - 1.0))
    c, s = np.array(compliance), np.array(strains)
    return {
        "spirals": len(spirals),
        "compliance_median": float(np.median(c)),
        "compliance_95": float(np.quantile(c, 0.95)),
        "compliance_worst": float(c.max()),
        "strain_median": float(np.median(s)),
        "strain_95": float(np.quantile(s, 0.95)),
    }
