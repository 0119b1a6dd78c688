"""Third-party software in the zips: its licences, the places of its sources, and the wheel that ships without one of its parts.

``build_zip`` calls this for every zip. A wheel, a licence or a library that is not listed here is an error, so that nothing comes
in unseen with a new version.
"""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterable, Iterator
from email.parser import HeaderParser
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

# what may stand beside the program's own GPL-3.0-or-later, by the list of the Free Software Foundation; the words of each
# that are looked for in its text
COMPATIBLE = {
    "MIT": "Permission is hereby granted, free of charge",
    "BSD-3-Clause": "Redistribution and use in source and binary forms",
    "MPL-2.0": "Mozilla Public License",
    "GPL-3.0-or-later": "either version 3 of the License, or",
    "PSF-2.0": "PYTHON SOFTWARE FOUNDATION LICENSE",
}
# the same in the words of Python's classifiers, for wheels that say their licence no better
CLASSIFIERS = {"MIT License": "MIT", "BSD License": "BSD-3-Clause", "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0"}
# of what is compiled into a wheel without lying beside it, as its own list of parts says (CycloneDX): compatible too, by the same list
OF_PARTS = {
    "MIT",
    "MPL-2.0",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-3-Clause",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
}
UNSAID = {"sparrow": "MPL-2.0"}  # parts whose list leaves it out, by their own pages (github.com/JeroenGar/sparrow)


class Library(NamedTuple):
    """A compiled library of somebody else's beside a package: its licence, and where its source is."""

    licence: str
    source: str


class Package(NamedTuple):
    """A wheel that is shipped.

    licence : of the package's own code, SPDX; source : where that is; libraries : what compiled libraries lie beside it, by the
    beginnings of their names
    """

    licence: str
    source: str
    libraries: dict[str, Library] = {}


class Part(NamedTuple):
    """A library compiled into a wheel: name, version, licence (SPDX; "" where none is known), and its source if not in the usual place."""

    name: str
    version: str
    licence: str
    source: str = ""


_GCC = Library("GPL-3.0-or-later WITH GCC-exception-3.1", "https://gcc.gnu.org")
_GEOS = Library("LGPL-2.1-or-later", "https://github.com/libgeos/geos")
_MICROSOFT = Library(
    "redistributable of Microsoft's compiler, a system library in the sense of the GPL",
    "https://learn.microsoft.com/cpp/windows/redistributing-visual-cpp-files",
)
_OPENBLAS = Library("BSD-3-Clause", "https://github.com/OpenMathLib/OpenBLAS")
_SUITESPARSE = ("libamd", "libcamd", "libccolamd", "libcolamd", "libcholmod", "libumfpack", "libsuitesparseconfig")

# libraries as the wheels' own licence files and their makers' pages name them
PACKAGES = {
    "cvxopt": Package(
        "GPL-3.0-or-later",
        "https://github.com/cvxopt/cvxopt",
        {
            **dict.fromkeys(
                _SUITESPARSE,
                Library(
                    "BSD-3-Clause, LGPL-2.1-or-later or GPL-2.0-or-later, by the part (SuiteSparse)",
                    "https://github.com/DrTimothyAldenDavis/SuiteSparse",
                ),
            ),
            "libdsdp": Library("DSDP, a licence like MIT", "https://www.mcs.anl.gov/hs/software/DSDP"),
            "libfftw3": Library("GPL-2.0-or-later", "https://www.fftw.org"),
            "libglpk": Library("GPL-3.0-or-later", "https://www.gnu.org/software/glpk"),
            "libgsl": Library("GPL-3.0-or-later", "https://www.gnu.org/software/gsl"),
            "libgmp": Library("LGPL-3.0-or-later or GPL-2.0-or-later", "https://gmplib.org"),
            "libsatlas": Library("BSD-3-Clause", "https://math-atlas.sourceforge.net"),
            "libopenblas": _OPENBLAS,
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
            "libscipy_openblas": _OPENBLAS,
            **dict.fromkeys(("libgfortran", "libquadmath", "libgcc_s"), _GCC),
        },
    ),
    "shapely": Package(
        "BSD-3-Clause",
        "https://github.com/shapely/shapely",
        {"libgeos": _GEOS, "geos": _GEOS, "msvcp140": _MICROSOFT},
    ),
    "spyrrow": Package("MIT", "https://github.com/PaulDL-RS/spyrrow"),
    "svgelements": Package("MIT", "https://github.com/meerk40t/svgelements"),
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
NATIVE = re.compile(r"\.(so(\.\d+)*|dll|dylib|exe)$")
ALONE = (".dll", ".dylib", ".exe")  # never modules of Python, in any folder


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
    """List the reasons against shipping these wheels: unknown packages, licences that are not as listed, libraries nobody listed."""
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
            made_of = [*parts(content)]
            said = _metadata(content)
        if COMPATIBLE[package.licence] not in " ".join(texts.split()):
            found.append(f"{wheel.name}: no licence file with the words of {package.licence}")
        found += [f"{wheel.name}: {fault}" for fault in _unlike(package, said)]
        found += [
            f"{wheel.name}: {one.name} {one.version} inside is under '{one.licence or 'no licence that it says'}'"
            for one in made_of
            if not _allowed(one.licence)
        ]
        if name in LIGHTER:
            found += [f"{wheel.name}: {one} is to be left out" for one in names if not LIGHTER[name].fullmatch(one)]
        for one in names:
            base = PurePosixPath(one).name
            beside = any(part.endswith((".libs", ".dylibs")) for part in PurePosixPath(one).parts)
            if (
                (beside or base.endswith(ALONE))
                and NATIVE.search(base)
                and not base.startswith(tuple(package.libraries) or ("/",))
            ):
                found.append(f"{wheel.name}: the library {base} is not listed")
    return found


def parts(wheel: zipfile.ZipFile) -> Iterator[Part]:
    """List the libraries compiled into a wheel from its own lists (PEP 770); ``PACKAGES`` lists the libraries beside it."""
    for name in wheel.namelist():
        if not re.fullmatch(r"[^/]+\.dist-info/sboms/.+\.json", name):
            continue
        for one in json.loads(wheel.read(name))["components"]:
            if one.get("purl", "").startswith(("pkg:rpm/", "pkg:deb/", "pkg:apk/", "pkg:pypi/")):
                continue  # whose files lie beside it, and itself
            said = [each.get("expression") or each.get("license", {}).get("id", "") for each in one.get("licenses", ())]
            state = re.search(r"vcs_url=git\+(https://.+?)(?:\.git)?\?rev=(\w+)", unquote(one.get("purl", "")))
            source = f"{state[1]}/tree/{state[2]}" if state else ""
            yield Part(one["name"], one.get("version", ""), " AND ".join(said) or UNSAID.get(one["name"], ""), source)


def _allowed(licence: str) -> bool:
    """Return whether a part's licence (SPDX) allows one of ``OF_PARTS``."""
    every = [re.split(r" OR |/", one.strip("() ")) for one in licence.split(" AND ")]
    return all(any(way.strip() in OF_PARTS for way in ways) for ways in every)


def _metadata(wheel: zipfile.ZipFile) -> dict[str, list[str]]:
    """The words in which a wheel describes itself (packaging.python.org, core metadata), by their names."""
    found: dict[str, list[str]] = {}
    for name in wheel.namelist():
        if re.fullmatch(r"[^/]+\.dist-info/METADATA", name):
            for key, value in HeaderParser().parsestr(wheel.read(name).decode()).items():
                found.setdefault(key.lower(), []).append(str(value))
    return found


def _unlike(package: Package, said: dict[str, list[str]]) -> Iterator[str]:
    """List the differences between a wheel's metadata and our list."""
    last = [text.split(" :: ")[-1] for text in said.get("classifier", ()) if text.startswith("License :: ")]
    licences = said.get("license-expression") or [CLASSIFIERS[word] for word in last if word in CLASSIFIERS]
    if licences and licences != [package.licence]:
        yield f"it says that it is under {', '.join(licences)}, and {package.licence} is listed"
    places = " ".join([*said.get("project-url", ()), *said.get("home-page", ())])
    if package.source.removeprefix("https://") not in places:
        yield f"its source is listed as {package.source}, of which it says nothing"


def page(wheels: Iterable[Path]) -> str:
    """THIRD_PARTY.md: a row for every wheel with name, version, licence and source; then what is compiled that lies in them."""
    rows, libraries, compiled = [], [], []
    for wheel in sorted(wheels):
        name, version = wheel.name.split("-")[:2]
        package = PACKAGES[name.lower()]
        with zipfile.ZipFile(wheel) as content:
            texts = [one.split("/", 1)[-1] for one in _licences(content.namelist())]
            beside = sorted({PurePosixPath(one).name for one in content.namelist() if NATIVE.search(one)})
            inside = [*parts(content)]
        rows.append(f"| {name} | {version} | {package.licence} | <{package.source}> | {', '.join(texts)} |")
        for begin, library in package.libraries.items():
            files = [one for one in beside if one.startswith(begin)]
            if files:
                libraries.append(f"| {', '.join(files)} | {name} | {library.licence} | <{library.source}> |")
        for licence in sorted({one.licence for one in inside}):
            of = [
                f"{one.name} {one.version}" + f" (<{one.source}>)" * bool(one.source)
                for one in inside
                if one.licence == licence
            ]
            compiled.append(f"| {licence} | {name} | {', '.join(of)} |")
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
        *_section("Compiled libraries that lie inside some of these wheels:", ("library", "in", "licence", "source"), libraries),
        *_section("Parts that are compiled into them; the source of each is at `https://crates.io/crates/NAME/VERSION`, unless another place\n"
                  "is named:", ("licence", "in", "parts"), compiled),
        f"The report's page holds a part of three.js {three.group(1)} (MIT, <https://github.com/mrdoob/three.js>); its licence",
        "lies beside it, in `engine/runs/page/three.LICENSE.txt`.",
        "",
        f"Versions that end in `+{LOCAL}` are the wheels of that version without optional parts that FlexMaps never loads.",
        "",
    ])  # fmt: skip


def _section(said: str, columns: tuple[str, ...], rows: list[str]) -> list[str]:
    """A sentence and its table, where there is anything to tell."""
    if not rows:
        return []
    return [said, "", f"| {' | '.join(columns)} |", "|---" * len(columns) + "|", *rows, ""]


def _licences(names: Iterable[str]) -> list[str]:
    """The files of a wheel's own licence."""
    wanted = re.compile(r"[^/]+\.dist-info/(licenses/)?(LICEN[CS]E|COPYING)[^/]*$", re.IGNORECASE)
    return [name for name in names if wanted.match(name)]
