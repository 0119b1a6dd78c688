"""Check that the code in Markdown pages works: Python blocks run in a folder of small files, shell lines are read by the program's parsers,
and names of the program in running text exist.

A block is fenced with its language, or indented; of indented ones the first word tells what they are. Others (diagrams, load cases) are not
looked at. Blocks of one page follow each other, as a reader would type them. ``<!-- code: piece -->`` before a block: it goes on from an object
with spirals, as in the sidebar.

``python3 tools/dev.py python tools/site_code.py PAGE ...`` runs the Python blocks of pages, each in a folder of its own.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import os
import re
import shlex
import sys
import tempfile
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(
    r"^(?P<space> *)(?P<fence>```+|:::+)(?P<language>[^\n`]*)\n(?P<body>.*?)^(?P=space)(?P=fence)[ \t]*$",
    re.MULTILINE | re.DOTALL,
)
SPAN = re.compile(r"(?<!`)`([^`\n]+(?:\n(?!\n)[^`\n]+)?)`(?!`)")
PYTHON, SHELL = {"python", "py"}, {"sh", "shell", "bash", "console"}
PROGRAMS = ("blender", "flexmaps", "python3", "pip")
# what the blocks of a page find in their folder, each a small surface
FILES = ("surface.obj", "scan.stl")
PIECE = """
import bpy, flexmaps
from flexmaps import api
if not hasattr(bpy.types.Object, "flexmaps"):
    flexmaps.register()
bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
obj = api.show(api.spirals(api.load("shape:strip", edge=20)))
obj.flexmaps.render.pixels_x, obj.flexmaps.render.samples = 64, 1
bpy.context.view_layer.objects.active = obj
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("piece.blend"))
"""


@dataclass(frozen=True)
class Block:
    """A block of code: the line at which it begins, from 1 on, its language ("python", "shell" or ""), and what comes before it."""

    line: int
    language: str
    text: str
    setting: str = ""


def text_of(path: Path) -> str:
    """A page's Markdown; of a Python file, what it says at its top, which the reference shows."""
    text = path.read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "") if path.suffix == ".py" else text


def blocks(text: str) -> Iterator[Block]:
    """The blocks of a Markdown page, in their order."""
    found = []
    for one in FENCE.finditer(text):
        word = one["language"].strip().lower()
        language = "python" if word in PYTHON else "shell" if word in SHELL else ""
        body = re.sub(rf"^{one['space']}", "", one["body"], flags=re.MULTILINE)
        found.append(Block(text.count("\n", 0, one.start()) + 2, language, body, _setting(text[: one.start()])))
    blank = FENCE.sub(lambda one: "```" + "\n" * one.group(0).count("\n"), text)
    lines, at = blank.split("\n"), 0
    while at < len(lines):
        # indented after an empty line: by four, or inside an item of a list by four more than its text
        indent = re.match(r" {4,}(?=\S)", lines[at])
        if indent is None or (at and lines[at - 1].strip()) or _in_paragraph(lines, at):
            at += 1
            continue
        end = at
        while end < len(lines) and (lines[end].startswith(indent.group(0)) or not lines[end].strip()):
            end += 1
        body = "\n".join(line[len(indent.group(0)) :] for line in lines[at:end]).rstrip() + "\n"
        found.append(Block(at + 1, _language(body), body, _setting("\n".join(lines[:at]))))
        at = end
    yield from sorted(found, key=lambda block: block.line)


def _setting(before: str) -> str:
    """Return the setting in a comment right before a block."""
    found = re.search(r"<!-- code: (\w+) -->\s*$", before)
    return found.group(1) if found else ""


def _in_paragraph(lines: list[str], at: int) -> bool:
    """Whether an indented line is the text of an item of a list rather than code: fewer than four columns beyond the item's text."""
    before = next((line for line in reversed(lines[:at]) if line.strip() and not line.startswith("    ")), "")
    item = re.match(r"(?:[-*+]|\d+\.) +", before)
    return item is not None and len(re.match(r" *", lines[at]).group(0)) < len(item.group(0)) + 4  # type: ignore[union-attr]


def _language(body: str) -> str:
    first = body.split()[0] if body.split() else ""
    if first in PROGRAMS:
        return "shell"
    if first in ("import", "from"):
        return "python"
    try:
        ast.parse(body)
    except SyntaxError:
        return ""
    return "python" if "api." in body else ""


# -- shell -------------------------------------------------------------------------------------------------------------


def shell_faults(text: str) -> list[str]:
    """List the faults of a shell block: unknown commands, flags and values that the parsers refuse."""
    found = []
    for line in text.replace("\\\n", " ").splitlines():
        try:
            words = shlex.split(line, comments=True)
        except ValueError as error:
            found.append(f"{line.strip()}: {error}")
            continue
        if words:
            reason = _refused(words)
            found += [f"{line.strip()}: {reason}"] if reason else []
    return found


def _refused(words: list[str]) -> str:
    """Return why a command is refused; empty if it is accepted."""
    from flexmaps.command import arguments

    if words[:3] == ["blender", "--command", "flexmaps"]:
        words = words[2:]
    if words[0] == "flexmaps":
        said = io.StringIO()
        try:
            with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
                arguments.make_parser().parse_args(words[1:])
        except SystemExit as end:
            return said.getvalue().strip() if end.code else ""
        return ""
    if words[:2] == ["python3", "tools/dev.py"]:
        return _dev_refused(words[2:])
    return (
        "" if words[0] == "pip" and words[1:2] == ["install"] else f"{words[0]} is no command that these pages may use"
    )


def _dev_refused(words: list[str]) -> str:
    import dev

    words = words[2:] if words[:1] == ["--python"] else words
    if not words or words[0] not in dev.COMMANDS:
        return f"tools/dev.py has no command {words[:1]}"
    if words[0] == "run":
        return _refused(["flexmaps", *words])
    if words[0] == "python" and len(words) > 1 and words[1].endswith(".py") and "NAME" not in words[1]:
        return "" if (ROOT / words[1]).is_file() or "/" not in words[1] else f"there is no {words[1]}"
    if words[0] == "bench" and len(words) > 1 and words[1].islower():
        return "" if (ROOT / "tools" / f"bench_{words[1]}.py").is_file() else f"there is no bench {words[1]}"
    return ""


# -- names in running text ---------------------------------------------------------------------------------------------


def name_faults(text: str) -> list[str]:
    """Functions of ``api``, operators, commands and their flags that the running text names and the program does not have."""
    found = []
    for span in SPAN.findall(FENCE.sub("", text)):
        span = " ".join(span.split())
        found += [f"`{span}`: {reason}" for reason in _unknown(span)]
    return found


def _unknown(span: str) -> list[str]:
    from flexmaps import api

    found = [
        f"there is no api.{name}"
        for name in re.findall(r"\bapi\.(?!py\b)([A-Za-z_]\w*)", span)
        if not hasattr(api, name)
    ]
    operators = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "operators").glob("*.py")))
    for name in re.findall(r"bpy\.ops\.flexmaps\.(\w+)", span):
        if f'"flexmaps.{name}"' not in operators:
            found.append(f"there is no operator flexmaps.{name}")
    command = re.match(r"(?:blender --command )?flexmaps ([a-z]+)\b(.*)", span)
    if command is not None:
        import site_pages
        from flexmaps.command import arguments

        there = dict(site_pages.subparsers(arguments.make_parser()))
        if command.group(1) not in there:
            found.append(f"there is no command {command.group(1)}")
        else:
            known = there[command.group(1)]._option_string_actions
            found += [
                f"no flag {flag}" for flag in re.findall(r"(?<!\S)--[a-z][\w-]*", command.group(2)) if flag not in known
            ]
    elif span.startswith("python3 tools/dev.py "):
        reason = _dev_refused(span.split()[2:]) if "NAME" not in span else ""
        found += [reason] if reason and " run" not in span[:24] else []
    return found


# -- Python ------------------------------------------------------------------------------------------------------------


def python_faults(path: Path) -> tuple[int, list[str]]:
    """Run the Python blocks of a page, one after the other in one namespace and one empty folder; how many ran, and what failed."""
    from flexmaps import api

    found, ran, here = list[str](), 0, Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            names: dict[str, object] = {"__name__": "__main__", "os": os, "api": api}
            for block in blocks(text_of(path)):
                if block.language != "python":
                    continue
                ran += 1
                _small_files()
                try:
                    if block.setting == "piece":
                        exec(PIECE, names)
                    exec(compile(block.text, f"{path.name}:{block.line}", "exec"), names)
                except Exception:
                    found.append(f"{path.name}, line {block.line}: {traceback.format_exc().strip().splitlines()[-1]}")
        finally:
            os.chdir(here)
    return ran, found


def _small_files() -> None:
    """The files that the pages speak of: a saddle of 16 quads, for a block to run in a moment."""
    from flexmaps.engine.surface import shapes

    mesh = shapes.saddle(4)
    points = "".join(f"v {x} {z} {-y}\n" for x, y, z in mesh.vertices)  # y up, as .obj files are
    corners = "".join("f " + " ".join(str(k + 1) for k in quad) + "\n" for quad in mesh.quads)
    Path("surface.obj").write_text(points + corners, encoding="utf-8")


def summary(paths: Iterable[Path]) -> tuple[dict[str, int], list[str]]:
    """Count the blocks of each kind on pages, and list the faults of shell blocks and names, without running anything."""
    counts, found = dict.fromkeys(("python", "shell", ""), 0), list[str]()
    for path in paths:
        text = text_of(path)
        for block in blocks(text):
            counts[block.language] += 1
            if block.language == "shell":
                found += [f"{path.name}, line {block.line}: {fault}" for fault in shell_faults(block.text)]
        found += [f"{path.name}: {fault}" for fault in name_faults(text)]
    return counts, found


def main() -> int:
    parser = argparse.ArgumentParser(description="Run the Python blocks of Markdown pages.")
    parser.add_argument("pages", nargs="+", type=Path)
    status = 0
    for path in parser.parse_args(sys.argv[1:]).pages:
        ran, found = python_faults(path.resolve())
        print(f"{path.name}: {ran} blocks ran, {len(found)} failed", *found, sep="\n  ", flush=True)
        status |= bool(found)
    return status


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "tools"))
    end = main()
    sys.stdout.flush()
    os._exit(end)  # Blender as a module may wait for ever at the end of a process
