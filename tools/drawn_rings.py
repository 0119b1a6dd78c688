"""Reads the closed curves of sheets with svgelements and ezdxf, in millimetres, y up."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

TURN = 0.05  # radians, longest part of an arc that becomes one chord
Rings = dict[str, list[np.ndarray]]  # points (n, 2) of every closed curve, by layer or by colour


def svg_rings(path: Path) -> Rings:
    """Read an SVG file; the keys are colours such as ``#ff0000``."""
    import svgelements

    document, rings = svgelements.SVG.parse(str(path), ppi=25.4), defaultdict(list)
    for element in document.elements():
        for part in element.as_subpaths() if isinstance(element, svgelements.Path) else ():
            curve = svgelements.Path(part)
            if any(isinstance(piece, svgelements.Close) for piece in curve):
                steps = [
                    2 + int(abs(piece.sweep) / TURN) if isinstance(piece, svgelements.Arc) else 2 for piece in curve
                ]
                points = [
                    piece.point(s) for piece, n in zip(curve, steps, strict=True) for s in np.linspace(0, 1, n)[1:]
                ]
                rings[element.stroke.hex].append(np.array([(p.x, float(document.height) - p.y) for p in points]))
    return rings


def dxf_rings(path: Path, tolerance: float = 1e-3) -> Rings:
    """Read a DXF file; the keys are layers, and arcs become chords within ``tolerance``."""
    import ezdxf
    from ezdxf.path import make_path

    document, rings = ezdxf.readfile(path), defaultdict(list)  # type: ignore[attr-defined]
    assert not document.audit().errors
    for entity in document.modelspace().query("LWPOLYLINE POLYLINE CIRCLE"):
        line = make_path(entity)
        if line.is_closed:
            rings[entity.dxf.layer].append(np.array([(p.x, p.y) for p in line.flattening(tolerance)][:-1]))
    return rings
