"""The site as ``tools/dev.py site`` makes it, in a real browser; pictures are left in out/site to look at."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.timeout(600)  # Sphinx, and pages drawn by software, maybe on a busy machine


@pytest.fixture(scope="module")
def website() -> ModuleType:
    sys.path.append(str(ROOT / "tools"))
    import website

    return website


@pytest.mark.thorough
def test_the_site(website: ModuleType, tmp_path: Path) -> None:
    """Nothing that the generator complains of, no broken link, nothing asked of anybody, no message, no page wider than a phone."""
    import browser
    import site_links

    try:
        rows = website.build(tmp_path / "site")
    except website.NoGenerator as reason:
        pytest.skip(f"no site: {reason}")
    links = site_links.check(tmp_path / "site")
    assert [row.faults for row in rows] == [()]
    assert links.broken == ()
    assert links.loaded == ()
    assert links.count > 1000
    reason = browser.obstacle()
    if reason is not None:
        pytest.skip(reason)
    for row in website.check_in_browser(tmp_path / "site", website.PICTURES):
        assert row.count > 10
        assert row.faults == ()
