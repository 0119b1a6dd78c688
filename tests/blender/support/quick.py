"""Smaller searches, for tests of what is made of a search's result."""

from __future__ import annotations

import pytest
from flexmaps.engine import workers
from flexmaps.engine.extras.choosing import choose, layout_search
from flexmaps.engine.extras.scanning import register


def few_layouts(patch: pytest.MonkeyPatch, count: int = 5) -> None:
    """Compare few layouts, all in this process."""
    patch.setattr(workers, "count_cores", lambda: 1)
    patch.setattr(layout_search, "MAX_LAYOUTS", count)
    patch.setattr(layout_search, "MIN_LAYOUTS", count)
    patch.setattr(choose, "MAX_PARTS", 2)


def few_poses(patch: pytest.MonkeyPatch) -> None:
    """Register scans from few poses."""
    patch.setattr(register, "TILTS", register.TILTS[:2])
    patch.setattr(register, "OFFSETS", (-0.125, 0.0, 0.125))
