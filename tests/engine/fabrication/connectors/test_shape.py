"""Outlines of connectors against the sizes that they are drawn for."""

from __future__ import annotations

import pytest
from flexmaps.engine.fabrication.connectors.shape import ConnectorSize, head_curve
from shapely import LineString


def test_a_head_is_as_wide_as_its_size_says() -> None:
    """Each side gives up half of the clearance, measured across the middle of the head's end, and at the pad."""
    made = ConnectorSize(0.001, 0.002, 0.0015, 0.0005, 0.0005, 0.004, 1e-4, 0.0)
    line = LineString(head_curve(made).sample(1e-7))
    low, high = line.bounds[1], line.bounds[3]
    assert high - low == pytest.approx(made.pad_width, abs=2e-5)
    end = line.intersection(LineString([(made.length - 6e-5, -1.0), (made.length - 6e-5, 1.0)])).bounds
    slope = 0.5 * (made.head - made.neck) / made.length
    across = 2.0 * (0.5 * made.head - 6e-5 * slope - 0.5 * made.clearance * (1.0 + slope**2) ** 0.5)
    assert end[3] - end[1] == pytest.approx(across, abs=1e-6)
