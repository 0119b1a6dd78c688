"""Points of a scan's mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flexmaps.engine.extras.scanning import scan_reader


def test_a_face_gets_points_by_its_area(tmp_path: Path) -> None:
    """Two triangles apart from each other, one nine times as large, of which an eighth and more would be even by faces."""
    (tmp_path / "scan.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 0 0\nv 8 0 0\nv 5 3 0\nf 1 2 3\nf 4 5 6\n")
    points = scan_reader.read_scan(tmp_path / "scan.obj").points
    assert np.mean(points[:, 0] < 3.0) == pytest.approx(0.1, abs=0.01)
