"""What others wrote and the zips carry: its licences, where its source is, and the one wheel that is shipped without a part.

``build_zip`` calls this for every zip. A wheel, a licence or a library that is not listed here is an error, so that nothing comes
in unseen with a new version.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import NamedTuple

# what may stand beside the program's own GPL-3.0-or-later, by the list of the Free Software Foundation; the words of each
# that are looked for in its text
COMPATIBLE = {
    "MIT": "Permission is hereby granted, free of charge",
    "BSD-3-Clause": "Redistribution and use in source and binary forms",
    "MPL-2.0": "Mozilla Public License",
    "GPL-3.0-or-later": "either version 3 of the License, or",
    "PSF-2.0": "PYTHON SOFTWARE FOUNDATION LICENSE",
}


class Package(NamedTuple):
    """A wheel that is shipped.

    licence : of the package's own code, SPDX; source : where that is; libraries : what compiled libraries lie beside it, by the
    beginnings of their names, and their licences
    """

    licence: str
    source: str
    libraries: dict[str, str] = {}


_GCC = "GPL-3.0-or-later WITH GCC-exception-3.1"
_MICROSOFT = "redistributable of Microsoft's compiler, a system library in the sense of the GPL"
_SUITESPARSE = ("libamd", "libcamd", "libccolamd", "libcolamd", "libcholmod", "libumfpack", "libsuitesparseconfig")

# libraries as the wheels' own licence files and their makers' pages name them
PACKAGES = {
    "cvxopt": Package(
        "GPL-3.0-or-later",
        "https://github.com/cvxopt/cvxopt",
        {
            **dict.fromkeys(
                _SUITESPARSE, "BSD-3-Clause, LGPL-2.1-or-later or GPL-2.0-or-later, by the part (SuiteSparse)"
            ),
            "libdsdp": "DSDP, a licence like MIT",
            "libfftw3": "GPL-2.0-or-later",
            "libglpk": "GPL-3.0-or-later",
            "libgsl": "GPL-3.0-or-later",
            "libgmp": "LGPL-3.0-or-later or GPL-2.0-or-later",
            "libsatlas": "BSD-3-Clause",
            "libopenblas": "BSD-3-Clause",
            **dict.fromkeys(("libgfortran", "libquadmath", "libgcc_s", "libgomp"), _GCC),
        },
    ),
    "ezdxf": Package("MIT", "https://github.com/mozman/ezdxf"),
    "fonttools": Package("MIT", "https://github.com/fonttools/fonttools"),
    "jinja2": Package("BSD-3-Clause", "https://github.com/pallets/jinja"),
    "libigl": Package("MPL-2.0", "https://github.com/libigl/libigl-python-bindings"),
    "markupsafe": Package("BSD-3-Clause", "https://github.com/pallets/markupsafe"),
    "polib": Package("MIT", "https://github.com/izimobil/polib"),
    "pyparsing": Package("MIT", "https://github.com/pyparsing/pyparsing"),
    "scipy": Package(
        "BSD-3-Clause",
        "https://github.com/scipy/scipy",
        {
            "libscipy_openblas": "BSD-3-Clause",
            **dict.fromkeys(("libgfortran", "libquadmath", "libgcc_s"), _GCC),
        },
    ),
    "shapely": Package(
        "BSD-3-Clause",
        "https://github.com/shapely/shapely",
        {"libgeos": "LGPL-2.1-or-later", "geos": "LGPL-2.1-or-later", "msvcp140": _MICROSOFT},
    ),
    "spyrrow": Package("MIT", "https://github.com/PaulDL-RS/spyrrow"),
    "threadpoolctl": Package("BSD-3-Clause", "https://github.com/joblib/threadpoolctl"),
    "typing_extensions": Package("PSF-2.0", "https://github.com/python/typing_extensions"),
    "xatlas": Package("MIT", "https://github.com/mworchel/xatlas-python"),
}
# What Blender itself brings, by its build files (build_environment/cmake/versions.cmake): all its lines from 5.0 on in one version,
# or in another one from line to line (None), 4.2 to 5.2. A wheel of another version in any extension is what all of them get
BUNDLED: dict[str, str | None] = {
    "attrs": "25.3.0",
    "cattrs": "25.1.1",
    "fastjsonschema": "2.21.1",
    "typing_extensions": "4.14.1",
    **dict.fromkeys(
        (
            "autopep8",
            "certifi",
            "charset_normalizer",
            "cython",
            "idna",
            "numpy",
            "pycodestyle",
            "requests",
            "urllib3",
            "zstandard",
        )
    ),
}
# libigl's wheel also holds Shewchuk's Triangle, which may not be sold, TetGen and CGAL, and what is needed to compile against
# it. Nothing of that is ever loaded; what is kept is its core with the descriptions of the wheel
LIGHTER = {"libigl": re.compile(r"igl/(__init__\.py|pyigl_core\..*)|libigl-[^/]*\.dist-info/.*")}
LOCAL = "flexmaps"  # the local version label (PEP 440) of a wheel that was changed
PAGE = Path(__file__).resolve().parent.parent / "engine" / "runs" / "page"
NATIVE = re.compile(r"\.(so(\.\d+)*|dll|dylib)$")


def lighter(wheel: Path, folder: Path) -> Path:
    """A wheel in a folder as it is shipped: without what ``LIGHTER`` leaves out, its record and version saying so."""
    name, version, *tags = wheel.name.removesuffix(".whl").split("-")
    kept = LIGHTER.get(name)
    if kept is None:
        target = folder / wheel.name
        target.write_bytes(wheel.read_bytes())
        return target
    renamed = f"{version}+{LOCAL}"
    old, new = f"{name}-{version}.dist-info", f"{name}-{renamed}.dist-info"
    target = folder / ("-".join((name, renamed, *tags)) + ".whl")
    record = io.StringIO()
    rows = csv.writer(record, lineterminator="\n")
    with zipfile.ZipFile(wheel) as given, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as made:
        for entry in given.infolist():
            if entry.is_dir() or not kept.fullmatch(entry.filename) or entry.filename.endswith("/RECORD"):
                continue
            data = given.read(entry)
            if entry.filename == f"{old}/METADATA":
                data = _changed(data.decode(), version, renamed).encode()
            path = entry.filename.replace(old, new)
            made.writestr(zipfile.ZipInfo(path, entry.date_time), data, zipfile.ZIP_DEFLATED)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            rows.writerow((path, f"sha256={digest}", len(data)))
        rows.writerow((f"{new}/RECORD", "", ""))
        made.writestr(f"{new}/RECORD", record.getvalue())
    return target


def _changed(metadata: str, version: str, renamed: str) -> str:
    """The metadata of a wheel of which parts were left out."""
    text, count = re.subn(rf"^Version: {re.escape(version)}$", f"Version: {renamed}", metadata, flags=re.MULTILINE)
    assert count == 1
    note = (
        "This copy was made from the wheel of that version for the FlexMaps extension: its core alone, without the modules "
        "triangle, tetgen, cgal, embree, predicates, spectra and cycodebase, and without headers. Nothing else was changed.\n"
    )
    return text.rstrip("\n") + "\n\n" + note


def faults(wheels: Iterable[Path]) -> list[str]:
    """What speaks against shipping these wheels: unknown packages, licences that are not as listed, libraries nobody listed."""
    found = []
    for wheel in wheels:
        name = wheel.name.split("-")[0].lower()
        package = PACKAGES.get(name)
        bundled = BUNDLED.get(name, wheel.name.split("-")[1])
        if bundled != wheel.name.split("-")[1]:
            found.append(f"{wheel.name}: Blender brings {name} {bundled or 'of its own'}, which this would replace")
        if package is None:
            found.append(f"{wheel.name}: a package that third_party.py does not list; look up its licence")
            continue
        with zipfile.ZipFile(wheel) as content:
            names = content.namelist()
            texts = " ".join(content.read(one).decode(errors="ignore") for one in _licences(names))
        if COMPATIBLE[package.licence] not in " ".join(texts.split()):
            found.append(f"{wheel.name}: no licence file with the words of {package.licence}")
        if name in LIGHTER:
            found += [f"{wheel.name}: {one} is to be left out" for one in names if not LIGHTER[name].fullmatch(one)]
        for one in names:
            base = PurePosixPath(one).name
            beside = any(part.endswith((".libs", ".dylibs")) for part in PurePosixPath(one).parts)
            if beside and NATIVE.search(base) and not base.startswith(tuple(package.libraries) or ("/",)):
                found.append(f"{wheel.name}: the library {base} is not listed")
    return found


def page(wheels: Iterable[Path]) -> str:
    """THIRD_PARTY.md: a row for every wheel with name, version, licence and source; then the licences of the libraries in them."""
    rows, libraries = [], []
    for wheel in sorted(wheels):
        name, version = wheel.name.split("-")[:2]
        package = PACKAGES[name.lower()]
        with zipfile.ZipFile(wheel) as content:
            texts = [one.split("/", 1)[-1] for one in _licences(content.namelist())]
            beside = {PurePosixPath(one).name for one in content.namelist() if NATIVE.search(one)}
        rows.append(f"| {name} | {version} | {package.licence} | <{package.source}> | {', '.join(texts)} |")
        for begin, licence in package.libraries.items():
            if any(one.startswith(begin) for one in beside):
                libraries.append(f"| {begin} | {name} | {licence} |")
    three = re.search(r"three\.js ([\d.]+)", (PAGE / "three.min.js").read_text(encoding="utf-8")[:200])
    assert three is not None
    return "\n".join([
        "# Third party software",
        "",
        "FlexMaps is GPL-3.0-or-later. Its zip carries these Python packages as wheels, each with its licence text inside, at the",
        "place that the last column names. Their source is where the fourth column says.",
        "",
        "| package | version | licence | source | text |",
        "|---|---|---|---|---|",
        *rows,
        "",
        *(["Compiled libraries that lie inside some of these wheels:", "", "| library | in | licence |", "|---|---|---|", *libraries, ""]
          if libraries else []),
        f"The report's page holds a part of three.js {three.group(1)} (MIT, <https://github.com/mrdoob/three.js>); its licence",
        "lies beside it, in `engine/runs/page/three.LICENSE.txt`.",
        "",
        f"Versions that end in `+{LOCAL}` are the wheels of that version without optional parts that FlexMaps never loads.",
        "",
    ])  # fmt: skip


def _licences(names: Iterable[str]) -> list[str]:
    """The files of a wheel's own licence."""
    wanted = re.compile(r"[^/]+\.dist-info/(licenses/)?(LICEN[CS]E|COPYING)[^/]*$", re.IGNORECASE)
    return [name for name in names if wanted.match(name)]
