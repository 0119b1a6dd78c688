"""Benchmark of installing in a fresh Blender: sizes of the zips, seconds to enable them and to the first button."""

from __future__ import annotations

import build_zip
import fresh_blender
from harness import Bench, Options, Rows, at_most, note, temporary_folder

MEGABYTE = 1e6  # bytes, as in what download pages say
# required: megabytes per zip, seconds until it is enabled, seconds from the repository to the first button
SIZE, ENABLE, BUTTON = 75.0, 0.2, 60.0
OWN = build_zip.own_platform()


def sizes(options: Options) -> Rows:
    """Weigh the zips of the platform."""
    with temporary_folder() as place:
        for platform in build_zip.PLATFORMS if options.platform == "all" else [options.platform]:
            for line in build_zip.usual_lines(platform):
                size = build_zip.build(platform, line, place).stat().st_size / MEGABYTE
                yield at_most(f"{platform} {build_zip.LINES[line].python}", "zip, MB", SIZE, size)


def install(options: Options) -> Rows:
    """Install a zip from the disk, and from a repository on the loopback, each in a Blender that never saw it."""
    if OWN is None:
        yield note("this machine", "install", "no zip is made for its system")
        return
    name, line = f"{OWN} {build_zip.LINES[build_zip.own_line()].python}", build_zip.own_line()
    with temporary_folder() as place:
        one, two, shop = (place / folder for folder in ("disk", "online", "shop"))
        for folder in (one, two):
            folder.mkdir()
        path = build_zip.build(OWN, line, place)
        own = fresh_blender.environment(one)
        words = (str(path), *["enable"] * (1 + options.repeat))
        _, first, *later = [fresh_blender.run_script(fresh_blender.SCRIPT, word, one, own) for word in words]
        best = min(float(each["enable_cpu_s"]) for each in later)
        yield at_most(name, "enable, s of the processor", ENABLE, best, {"the first time": first["enable_cpu_s"]})
        build_zip.repository([path], shop)
        with fresh_blender.serve_folder(shop) as address:
            own = fresh_blender.environment(two)
            told = fresh_blender.run_script(fresh_blender.FROM_REPOSITORY, f"{address}/index.json", two, own)
    yield at_most(name, "from repository to first button, s", BUTTON, told["button_s"])


main = Bench(
    "install", {"sizes": sizes, "install": install}, patterns=None,
    platform=(OWN or "all", "whose zips are weighed, or all"),
    repeat=(3, "how often enabling is measured after the first time, when Python compiles it; the best counts"),
)  # fmt: skip
