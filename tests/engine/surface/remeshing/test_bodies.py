"""Bodies too small for the wanted number of quads: left out and said, or refused with both ways on."""

from __future__ import annotations

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.checking.finding import Finding
from flexmaps.engine.surface.remeshing.bodies import choose_bodies

FEWEST = 6


def kept_of(areas: np.ndarray, count: int, crumbs: float) -> tuple[np.ndarray, list[Finding]]:
    return choose_bodies(areas, count, np.full(len(areas), FEWEST), crumbs)


@pytest.mark.parametrize("small", [0.001, 0.005, 0.011])
@pytest.mark.parametrize("many", [1, 5, 9, 40, 400])
def test_few_crumbs_go_some_are_kept_and_many_stop(many: int, small: float) -> None:
    """100 quads for one large body and some small ones, of which a tenth may go; 200 quads are the most that there can be."""
    areas = np.array([1.0] + many * [small])
    share = many * small / areas.sum()
    fewest_kept = int(np.ceil((0.9 * areas.sum() - 1.0) / small - 1e-9)) if share > 0.1 else 0
    if (1 + fewest_kept) * FEWEST > 200:
        with pytest.raises(FlexMapsError, match=r"--remesh \d+.*--crumbs 0\.\d+") as told:
            kept_of(areas, 100, 0.1)
        assert kept_of(areas, 100, share + 1e-9)[0].sum() == 1
        enough = int(str(told.value).split("--remesh ")[1].split(")")[0])
        assert told.value.quads == enough
    else:
        large, found = kept_of(areas, 100, 0.1)
        assert large.sum() == 1 + fewest_kept and large[0]
        assert [one.code for one in found] == ["bodies-left-out"]
        left = many - fewest_kept
        assert f"{left} of {many + 1} bodies" in found[0].message
        assert f"{100 * left * small / areas.sum():.2g} %" in found[0].message
        enough = int(found[0].message.split("ask for ")[1].split(" quads")[0])
    assert kept_of(areas, enough, 0.0)[0].all(), "so many quads keep them"


def test_equal_bodies_are_all_kept() -> None:
    assert kept_of(np.ones(50), 100, 0.1)[0].all()


def test_bodies_with_too_few_quads_by_area_get_them_where_all_have_enough() -> None:
    """Five bodies, of which the small ones have 14 % together: leaving one of them out is a tenth at most."""
    large, found = kept_of(np.array([1.0, 0.04, 0.04, 0.04, 0.04]), 30, 0.1)
    assert large.sum() == 3 and "2 of 5" in found[0].message
    assert large[0]


def test_each_body_needs_its_own_number_of_quads() -> None:
    """Of two small bodies with eight quads each by area, the one that needs twelve goes."""
    large, found = choose_bodies(np.array([1.0, 0.08, 0.08]), 116, np.array([6, 6, 12]), 0.1)
    assert large.tolist() == [True, True, False]
    assert "1 of 3 bodies would get fewer than 12 quads" in found[0].message
