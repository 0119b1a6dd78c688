"""Benchmark of installing: sizes of the zips, seconds to enable the extension, seconds from a repository to the first button.

python3 tools/dev.py bench install [--platform all] [--json FILE] [--repeat 3]

In a Blender as a module that has nothing else (``fresh_blender``); ``bench blender --only survey`` enables it in a real one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import build_zip
import fresh_blender
from harness import Bench
from rows import Row, at_most, note

MEGABYTE = 1e6  # bytes, as in what download pages say
# required: megabytes per zip, seconds until it is enabled, seconds from the repository to the first button
SIZE, ENABLE, BUTTON = 75.0, 0.2, 60.0


def main(arguments: list[str]) -> int:
    """Build, measure and print the table; return 0 whatever the figures."""
    own = build_zip.own_platform()
    bench = Bench(
        "install", arguments, 36,
        platform=(own or "all", "whose zips are weighed, or all"),
        repeat=(3, "how often enabling is measured after the first time, when Python compiles it; the best counts"),
    )  # fmt: skip
    wanted = bench.options.platform
    with tempfile.TemporaryDirectory() as place:
        for platform in build_zip.PLATFORMS if wanted == "all" else [wanted]:
            for line in build_zip.usual(platform):
                size = build_zip.build(platform, line, Path(place)).stat().st_size / MEGABYTE
                bench.table.add(at_most(f"{platform} {build_zip.LINES[line].python}", "zip, MB", SIZE, size))
        if own is None:
            bench.table.add(note("this machine", "install", "no zip is made for its system"))
        else:
            for one in _rows_of_install(build_zip.build(own, build_zip.own_line(), Path(place)), bench.options.repeat):
                bench.table.add(one)
    return bench.finish()


def _rows_of_install(path: Path, repeat: int) -> Iterator[Row]:
    """A zip from the disk and the same from a repository on the loopback, each in a Blender that never saw it."""
    name = f"{build_zip.own_platform()} {build_zip.LINES[build_zip.own_line()].python}"
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        own = fresh_blender.environment(folder)
        words = (str(path), *["enable"] * (1 + repeat))
        installed, first, *later = [fresh_blender.told(fresh_blender.SCRIPT, word, folder, own) for word in words]
    yield note(name, "install from the disk, s", round(installed["install_s"], 2))
    best = min(later, key=lambda one: float(one["enable_cpu_s"]))
    once = {"with waiting": round(best["enable_s"], 2), "the first time": round(first["enable_cpu_s"], 2)}
    yield at_most(name, "enable, s of the processor", ENABLE, best["enable_cpu_s"], once)
    with tempfile.TemporaryDirectory() as place:
        folder, shop = Path(place) / "blender", Path(place) / "shop"
        folder.mkdir()
        build_zip.repository([path], shop)
        with fresh_blender.served(shop) as address:
            told = fresh_blender.told(
                fresh_blender.FROM_REPOSITORY, f"{address}/index.json", folder, fresh_blender.environment(folder)
            )
    peer = {"installed": round(told["installed_s"], 1), "of the processor": round(told["button_cpu_s"], 1)}
    yield at_most(name, "from repository to first button, s", BUTTON, told["button_s"], peer)
