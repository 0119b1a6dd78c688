"""What the tool that puts zips together finds in wheels that say another licence than is listed, or hold parts of one."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

MIT = "Permission is hereby granted, free of charge, to any person"
METADATA = (
    "Metadata-Version: 2.4\nName: spyrrow\nVersion: 9\nProject-URL: source, https://github.com/PaulDL-RS/spyrrow\n"
)


@pytest.fixture
def faults(build_zip: ModuleType, tmp_path: Path) -> Any:
    """A function that makes a wheel of some metadata and parts, and tells what speaks against it."""

    def made(metadata: str = METADATA, parts: tuple[dict[str, Any], ...] = ()) -> list[str]:
        wheel = tmp_path / "spyrrow-9-py3-none-any.whl"
        with zipfile.ZipFile(wheel, "w") as content:
            content.writestr("spyrrow-9.dist-info/METADATA", metadata)
            content.writestr("spyrrow-9.dist-info/licenses/LICENSE", MIT)
            content.writestr("spyrrow-9.dist-info/sboms/spyrrow.cyclonedx.json", json.dumps({"components": parts}))
        found: list[str] = build_zip.third_party.faults([wheel])
        return found

    return made


def part(licence: str | None, name: str = "stranger") -> dict[str, Any]:
    said = {} if licence is None else {"licenses": [{"expression": licence}]}
    return {"name": name, "version": "1.0", "purl": f"pkg:cargo/{name}@1.0", **said}


@pytest.mark.parametrize(
    "licence", ["MIT", "MPL-2.0", "MIT OR Apache-2.0", "(GPL-2.0-only OR MIT) AND Unicode-3.0", "Unlicense/MIT", "Zlib"]
)
def test_parts_that_may_be_inside(faults: Any, licence: str) -> None:
    assert faults(parts=(part(licence),)) == []


@pytest.mark.parametrize("licence", ["GPL-2.0-only", "SSPL-1.0", "MIT AND LicenseRef-own", "", None])
def test_parts_that_may_not(faults: Any, licence: str | None) -> None:
    (one,) = faults(parts=(part(licence),))
    assert "stranger 1.0 inside is under" in one


def test_what_is_known_of_a_part_that_says_nothing(faults: Any) -> None:
    """And libraries whose files lie beside the package are looked at as files."""
    library = {"name": "fftw", "purl": "pkg:rpm/almalinux/fftw@3"}
    assert faults(parts=(part(None, "sparrow"), library)) == []


def test_a_wheel_that_says_something_else(faults: Any) -> None:
    assert faults(METADATA + "License-Expression: MIT\n") == []
    assert faults(METADATA + "Classifier: License :: OSI Approved :: MIT License\n") == []
    (one,) = faults(METADATA + "License-Expression: Apache-2.0\n")
    assert "it says that it is under Apache-2.0, and MIT is listed" in one
    (one,) = faults(METADATA + "Classifier: License :: OSI Approved :: BSD License\n")
    assert "BSD-3-Clause" in one
    (one,) = faults(METADATA.replace("PaulDL-RS", "somebody"))
    assert "its source is listed as https://github.com/PaulDL-RS/spyrrow" in one
