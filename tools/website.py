"""``site`` of tools/dev.py: builds the site in docs/site, checks its links, code and pages in a browser, and prints a table.

Sphinx makes it (MyST for Markdown, Furo for the look), from a folder of packages of its own, so that no environment of the program changes.
The site asks for nothing from anywhere: no fonts, no scripts of others. Any web server can hold it, or none: it opens from the disk.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import browser
import build_zip
import site_code
import site_links
import site_pages

ROOT = Path(__file__).resolve().parent.parent
SOURCE, TARGET, PICTURES = ROOT / "build" / "site", ROOT / "docs" / "site", ROOT / "out" / "site"
WEBSITE = ROOT / "tools" / "website"
# the front page's pictures, which no page of Sphinx's names, or not by these names
FRONT = ("hero.jpg", "assembly.webp", "tutorial/shape.jpg", "tutorial/sheet.jpg", "gallery/canopy.jpg", "gallery/torus.jpg",
         "gallery/three-holes.jpg", "gallery/suzanne.jpg")  # fmt: skip
# of which pictures are kept
SEEN = (
    "index",
    "quickstart",
    "tutorial",
    "guide",
    "gallery",
    "api",
    "settings",
    "commands",
    "glossary",
    "examples/16_four_widths",
)
SIZES = ("wide", "phone")
INSTALL = "install"  # folder of the site that holds a repository


class NoGenerator(RuntimeError):
    """The packages that make the site are not here and cannot be fetched."""


@dataclass(frozen=True)
class Row:
    """One line of the table: what, how many there are, and what is wrong with them."""

    what: str
    count: int
    faults: tuple[str, ...]


def main(argv: list[str]) -> int:
    """Build and check; the exit status is 0 where nothing is wrong."""
    parser = argparse.ArgumentParser(prog="site", description="Make the site in docs/site and check it.")
    parser.add_argument("--repository", type=Path, metavar="DIR",
                        help="a folder made by 'build --repository DIR': it becomes a part of the site, and the install button leads there")  # fmt: skip
    parser.add_argument("--no-code", action="store_true", help="do not run the pages' Python")
    parser.add_argument("--no-browser", action="store_true", help="do not look at it in a browser")
    wanted = parser.parse_args(argv)
    try:
        rows = build(TARGET, wanted.repository)
    except RuntimeError as error:
        print(f"No site: {error}", file=sys.stderr)
        return 2
    links = site_links.check(TARGET)
    rows += [
        Row("links within the site", links.count, links.broken),
        Row("addresses that a page asks for by itself", len(links.loaded), links.loaded),
    ]
    rows += check_code(run=not wanted.no_code)
    reason = "left out" if wanted.no_browser else browser.obstacle()
    if reason is None:
        rows += check_in_browser(TARGET, PICTURES)
    table(rows)
    if reason is not None:
        print(f"not looked at in a browser: {reason}")
    print(f"{len(links.elsewhere)} addresses elsewhere, not asked:", *links.elsewhere, sep="\n  ")
    print(f"{TARGET / 'index.html'}")
    return 1 if any(row.faults for row in rows) else 0


def table(rows: list[Row]) -> None:
    """Format the results, with every fault below its line."""
    width = max(len(row.what) for row in rows)
    print(f"{'what':{width}}  there  wrong  asked")
    for row in rows:
        print(f"{row.what:{width}}  {row.count:5}  {len(row.faults):5}      0")
        for fault in row.faults:
            print(f"    {fault}")


# -- the generator -----------------------------------------------------------------------------------------------------


def packages() -> Path:
    """The folder of the packages that make the site, filled on the first call. Raises ``NoGenerator``."""
    folder = ROOT / ".venv-site-{}.{}".format(*sys.version_info[:2])
    pins = WEBSITE / "locked.txt"  # what requirements.txt beside it names, with checksums
    stamp, wanted = folder / "flexmaps-stamp", hashlib.sha256(pins.read_bytes()).hexdigest()
    if stamp.is_file() and stamp.read_text() == wanted:
        return folder
    print(f"Fetching what makes the site into {folder.name} (once, about 30 MB)", flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--no-input",
        "install",
        "-q",
        "--no-deps",
        "--require-hashes",
        "--target",
    ]
    done = subprocess.run([*pip, str(folder), "-r", str(pins)], capture_output=True, text=True)
    if done.returncode:
        shutil.rmtree(folder, ignore_errors=True)
        raise NoGenerator("pip could not fetch it: " + " ".join((done.stdout + done.stderr).split())[-300:])
    stamp.write_text(wanted)
    return folder


def build(target: Path, repository: Path | None = None) -> list[Row]:
    """Make the site in a folder, in the place of an earlier one; what the generator had to say. Raises ``NoGenerator``."""
    path = packages()
    site_pages.lay_out(SOURCE)
    part = target.with_name(target.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    install = "quickstart.html#install" if repository is None else f"{INSTALL}/index.html"
    sphinx = [sys.executable, "-m", "sphinx", "-q", "-E", "-b", "html", "-c", str(WEBSITE), "-d", str(SOURCE.with_name("site-doctrees")),
              "-D", "language=en", "-A", f"install={install}", str(SOURCE), str(part)]  # fmt: skip
    paths = [str(path), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(paths), SOURCE_DATE_EPOCH=str(int(time.time())))
    done = subprocess.run(sphinx, env=environment, capture_output=True, text=True)
    said = [line for line in (done.stdout + done.stderr).splitlines() if "WARNING" in line or "ERROR" in line]
    if done.returncode:
        raise RuntimeError("Sphinx ended with an error:\n" + (done.stdout + done.stderr)[-3000:])
    (part / "_images").mkdir(exist_ok=True)
    for name in FRONT:
        shutil.copyfile(ROOT / "docs" / "images" / name, part / "_images" / Path(name).name)
    if repository is not None:
        shutil.copytree(repository, part / INSTALL, copy_function=build_zip.link_or_copy)
    shutil.rmtree(target, ignore_errors=True)
    part.rename(target)
    return [Row("pages", len(list(target.rglob("*.html"))), tuple(said))]


# -- what it is checked by ---------------------------------------------------------------------------------------------


def checked_pages() -> list[Path]:
    """The pages whose code is checked, and the first words of the API; the examples are run by tests of their own."""
    pages = [
        ROOT / name
        for name in site_pages.PAGES
        if name.endswith(".md") and not name.startswith(("tools/", "database/"))
    ]
    return [*pages, ROOT / "README.md", ROOT / "api" / "__init__.py"]


def check_code(run: bool) -> list[Row]:
    """Blocks and names of all pages; with ``run`` the Python blocks run, page by page, in processes of their own."""
    pages = checked_pages()
    counts, faults = site_code.summary(pages)
    rows = [Row("shell blocks, and names of the program in the text", counts["shell"], tuple(faults))]
    if run:
        broken: list[str] = []
        with_code = [
            page for page in pages if any(b.language == "python" for b in site_code.blocks(site_code.text_of(page)))
        ]
        command = [
            sys.executable,
            str(ROOT / "tools" / "dev.py"),
            "python",
            str(ROOT / "tools" / "site_code.py"),
            *map(str, with_code),
        ]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            broken = [line.strip() for line in done.stdout.splitlines() if line.startswith("  ")] or [
                done.stderr.strip()[-300:]
            ]
        rows.append(Row("Python blocks that were run", counts["python"], tuple(broken)))
    return rows


def check_in_browser(folder: Path, pictures: Path) -> list[Row]:
    """All pages in a browser, at the width of a desktop and of a phone, some dark too; pictures of some to look at."""
    said, wide, count = list[str](), list[str](), 0
    every = sorted(path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.html"))
    for size in SIZES:
        for dark in (False, True):
            with browser.Browser(size, dark=dark) as page:
                for name in every if not dark else SEEN[:3]:
                    path = folder / f"{name}.html"
                    page.open(path)
                    count += 1
                    where = f"{name}, {size}, {'dark' if dark else 'light'}"
                    said += [f"{where}: {text}" for text in page.messages]
                    said += [
                        f"{where} asks for {url}" for url in page.requests if not url.startswith(("file:", "data:"))
                    ]
                    over = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
                    wide += [f"{where}: {over} pixels"] if over > 0 else []
                    if name in SEEN:
                        page.picture(pictures / f"{Path(name).name}-{size}{'-dark' * dark}.png")
    return [
        Row("messages and requests in a browser", count, tuple(said)),
        Row("pages wider than the window", count, tuple(wide)),
    ]
