"""The registry names every folder of the extras, and modules that there are."""

from __future__ import annotations

from pathlib import Path

import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.extras import registry
from flexmaps.engine.params import ObjectSettings, Settings


def test_every_folder_has_its_line_and_every_line_its_modules(root: Path) -> None:
    folders = {path.parent.name for path in (root / "engine" / "extras").glob("*/__init__.py")}
    assert folders == {extra.folder for extra in registry.REGISTRY}
    for kind in ("operators", "panels"):
        named = [name for extra in registry.REGISTRY for name in getattr(extra, kind)]
        assert all((root / kind / f"{name}.py").is_file() for name in named) and len(named) == len(set(named))
        assert registry.missing_modules(kind) == set()


def test_a_missing_folder_takes_its_modules_and_sections_along(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "structure" in registry.sections("Settings") and "film" in registry.sections("ObjectSettings")
    monkeypatch.setattr(registry, "has", lambda folder: folder not in {"structure", "film"})
    assert registry.missing_modules("operators") == {"structure", "animate"}
    assert registry.missing_modules("panels") == {"loads"}
    assert "structure" not in registry.sections("Settings") and "film" not in registry.sections("ObjectSettings")
    assert registry.stages()["structure"] == () != registry.stages()["scanning"]
    registry.need("scanning")
    with pytest.raises(FlexMapsError, match="Checking loads is not part of this copy"):
        registry.need("structure")


def test_a_section_is_found_by_its_class() -> None:
    kind = registry.sections("Settings")["structure"]
    made = ObjectSettings()
    assert made.section(kind) is made.structure  # type: ignore[attr-defined]
    assert type(Settings().section(kind)) is kind
