"""Bodies too small for the wanted number of quads: left out and said, or refused with both ways on."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.remeshing.bodies import without_crumbs

FEWEST = 6


@pytest.mark.parametrize("small", [0.001, 0.005, 0.011])
@pytest.mark.parametrize("many", [1, 5, 9, 40])
def test_few_crumbs_go_and_many_stop(many: int, small: float) -> None:
    """100 quads for one large body and some small ones."""
    areas = np.array([1.0] + many * [small])
    share = many * small / areas.sum()
    if share > 0.1:
        with pytest.raises(FlexMapsError, match=r"--remesh \d+.*--crumbs 0\.\d+") as told:
            without_crumbs(areas, 100, FEWEST, 0.1)
        assert without_crumbs(areas, 100, FEWEST, share + 1e-9)[0].sum() == 1
        enough = int(str(told.value).split("--remesh ")[1].split(")")[0])
    else:
        large, found = without_crumbs(areas, 100, FEWEST, 0.1)
        assert large.tolist() == [True] + many * [False]
        assert [one.code for one in found] == ["bodies-left-out"]
        assert f"{many} of {many + 1} bodies" in found[0].message and f"{100 * share:.2g} %" in found[0].message
        enough = int(found[0].message.split("ask for ")[1].split(" quads")[0])
    assert without_crumbs(areas, enough, FEWEST, 0.0)[0].all(), "so many quads keep them"


def test_equal_bodies_are_all_kept() -> None:
    assert without_crumbs(np.ones(50), 100, FEWEST, 0.1)[0].all()


def test_bodies_with_too_few_quads_by_area_get_them_where_all_have_enough() -> None:
    """Five bodies, of which the small ones have 14 % together: leaving one of them out is a tenth at most."""
    large, found = without_crumbs(np.array([1.0, 0.04, 0.04, 0.04, 0.04]), 30, FEWEST, 0.1)
    assert large.sum() == 3 and "2 of 5" in found[0].message
    assert large[0]
