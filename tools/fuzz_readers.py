"""Fuzzing of the readers and checks with damaged mesh files, each generated from its number.

The seeds are the files of ``tests/corpus``: small ones of every format, and those that once were a fault. Mutations know the
formats: counts, indices, types and line ends are what is damaged, beside bytes.
"""

from __future__ import annotations

import random
import re
import warnings
from collections.abc import Callable
from pathlib import Path

from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import Settings, SheetParams
from flexmaps.engine.runs import job
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio

CORPUS = Path(__file__).parents[1] / "tests" / "corpus"
ODD = (
    b"0", b"-1", b"1", b"2", b"3", b"5", b"7", b"-0", b"255", b"256", b"65536", b"2147483647", b"2147483648", b"-2147483649",
    b"4294967295", b"9223372036854775807", b"9223372036854775808", b"1" * 30, b"1" * 5000, b"nan", b"inf", b"-inf", b"1e308",
    b"1e309", b"-1e160", b"1e-320", b"1e20", b"0.1", b".5", b"1e", b"x", b"", b"1_0", b"1,5", b"0x10", b"+2", b"--1", b"1/2/3",
    b"1//", b"/", b"#", b"\\", b"\0", b"\xff", b"\xef\xbb\xbf", "\u0661".encode(),
)  # fmt: skip
TYPES = (
    b"char",
    b"uchar",
    b"short",
    b"ushort",
    b"int",
    b"uint",
    b"float",
    b"double",
    b"int8",
    b"uint32",
    b"float64",
    b"x",
)
KEYWORDS = (
    b"v", b"f", b"vt", b"l", b"o", b"OFF", b"COFF", b"NOFF", b"STOFF", b"4OFF", b"nOFF", b"BINARY", b"end_header", b"element",
    b"property", b"list", b"comment", b"obj_info", b"format", b"ascii", b"binary_little_endian", b"binary_big_endian", b"face",
    b"vertex", b"edge", b"vertex_indices", b"vertex_index", b"x", b"solid", b"endsolid", b"facet", b"endfacet", b"outer", b"loop",
)  # fmt: skip
ENDS = (b"\n", b"\r\n", b"\r", b"\n\n", b" ", b"\t\n", b"\\\n", b" # c\n", b"\x0b", b"\x0c")
SMALL = 40  # faces of a mesh that may be made whole, to see that what passes the checks can be

Mutation = Callable[[random.Random, bytes], bytes]


def seeds() -> list[Path]:
    return sorted(p for p in CORPUS.iterdir() if p.suffix in meshio.SUFFIXES)


# -- mutations ---------------------------------------------------------------------------------------------------------


def _span(rng: random.Random, data: bytes, longest: int = 16) -> tuple[int, int]:
    start = rng.randint(0, len(data))
    return start, min(len(data), start + rng.randint(0, longest))


def _cut(rng: random.Random, data: bytes) -> bytes:
    start, end = _span(rng, data)
    return data[:start] + data[end:]


def _truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randint(0, len(data))]


def _noise(rng: random.Random, data: bytes) -> bytes:
    start, end = _span(rng, data, 4)
    return data[:start] + rng.randbytes(rng.randint(1, 4)) + data[end:]


def _bit(rng: random.Random, data: bytes) -> bytes:
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]


def _repeat(rng: random.Random, data: bytes) -> bytes:
    start, end = _span(rng, data, 60)
    return data[:end] + data[start:end] * rng.randint(1, 3) + data[end:]


def _move(rng: random.Random, data: bytes) -> bytes:
    start, end = _span(rng, data, 40)
    rest = data[:start] + data[end:]
    at = rng.randint(0, len(rest))
    return rest[:at] + data[start:end] + rest[at:]


def _head(data: bytes) -> int:
    """Return the length of the text of a file: all of it, or the header of a binary file."""
    end = data.find(b"end_header")
    return end + 10 if end >= 0 and b"binary" in data[:end] else len(data)


def _words(rng: random.Random, data: bytes, pattern: bytes, new: Callable[[bytes], bytes]) -> bytes:
    """Another word in the place of one that matches."""
    head = data[: _head(data)]
    found = list(re.finditer(pattern, head))
    if not found:
        return data
    word = rng.choice(found)
    return head[: word.start()] + new(word[0]) + head[word.end() :] + data[len(head) :]


def _number(rng: random.Random, data: bytes) -> bytes:
    def new(word: bytes) -> bytes:
        if rng.random() < 0.4 and re.fullmatch(rb"-?\d{1,9}", word):
            return b"%d" % (int(word) + rng.choice((-2, -1, 1, 2, 1000)) if rng.random() < 0.7 else -int(word))
        return rng.choice(ODD)

    return _words(rng, data, rb"-?[\d.]+(?:e-?\d+)?", new)


def _keyword(rng: random.Random, data: bytes) -> bytes:
    return _words(rng, data, rb"[A-Za-z_]{1,20}\d*", lambda word: rng.choice(KEYWORDS + TYPES))


def _type(rng: random.Random, data: bytes) -> bytes:
    return _words(rng, data, rb"\b(?:" + b"|".join(TYPES[:-1]) + rb")\b", lambda word: rng.choice(TYPES))


def _line_end(rng: random.Random, data: bytes) -> bytes:
    head = _head(data)
    end = rng.choice(ENDS)
    if rng.random() < 0.3:
        return data[:head].replace(b"\n", end) + data[head:]
    return _words(rng, data, rb"\r?\n", lambda word: end)


def _lines(rng: random.Random, data: bytes) -> bytes:
    head = _head(data)
    lines = data[:head].split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            lines[at], lines[to] = lines[to], lines[at]
        case 1:
            lines.insert(to, lines[at])
        case 2:
            del lines[at]
        case 3:
            lines[at] = lines[at] + b" " + lines[to]
    return b"\n".join(lines) + data[head:]


def _binary_number(rng: random.Random, data: bytes) -> bytes:
    """Four bytes that are an odd integer or single precision number."""
    at = rng.randint(0, max(len(data) - 4, 0))
    odd = (
        0,
        1,
        0xFFFFFFFF,
        0x7FFFFFFF,
        0x80000000,
        0x7F800000,
        0x7FC00000,
        0x7F7FFFFF,
        1 << 24,
        rng.randrange(1 << 32),
    )
    return data[:at] + rng.choice(odd).to_bytes(4, rng.choice(("little", "big"))) + data[at + 4 :]


MUTATIONS: tuple[Mutation, ...] = (
    _cut, _truncate, _noise, _bit, _repeat, _move, _number, _number, _number, _keyword, _type, _line_end, _lines, _lines,
    _binary_number,
)  # fmt: skip


def mutant(number: int) -> tuple[str, bytes]:
    """The name of the seed and the damaged file; always the same for a number, as long as the corpus is."""
    rng = random.Random(number)
    known = seeds()
    seed = known[number % len(known)]
    data = seed.read_bytes()
    if rng.random() < 0.05:  # two files in one
        other = rng.choice(known).read_bytes()
        data = data[: rng.randint(0, len(data))] + other[rng.randint(0, len(other)) :]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        data = rng.choice(MUTATIONS)(rng, data)
    return seed.name, data


# -- what must not be ----------------------------------------------------------------------------------------------------


def outcome(name: str, data: bytes, whole: bool = False) -> str:
    """Return how far the file is processed: "refused", "faulty" (not one that can be made) or "made"; anything but FlexMapsError gets out.

    whole : make a small mesh that passes the checks, down to the sheets
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            mesh = meshio.parse_mesh(data, name)
        except FlexMapsError as error:
            _sound(error)
            return "refused"
        check.findings(mesh)
        scaled = check.scale_to_metres(mesh, edge=0.02)
        found = check.findings(scaled)
        assert [f.code for f in found if f.is_error] or check.as_quad_mesh(scaled, found)
    for finding in found:
        assert finding.message
        assert "\n" not in finding.message
    if any(f.is_error for f in found):
        return "faulty"
    if whole and len(mesh.sizes) <= SMALL:
        try:
            job.run(mesh, Settings(sheet=SheetParams(nesting="FAST")), edge=0.02)
        except FlexMapsError as error:
            _sound(error)
            return "not made"
    return "made"


def _sound(error: FlexMapsError) -> None:
    assert str(error).strip()
    assert "\n" not in str(error)
    assert len(str(error)) < 500


def play(number: int, whole: bool) -> str:
    """The outcome of one mutant."""
    return outcome(*mutant(number), whole)


def described(number: int) -> str:
    """Describe the mutant."""
    name, data = mutant(number)
    return f"{name}, {len(data)} bytes: {data[:1500]!r}"
