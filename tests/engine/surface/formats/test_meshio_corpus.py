"""Mesh files that were a fault once, and damaged ones made anew: nothing but ``FlexMapsError`` comes of them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[4]
CORPUS = ROOT / "tests" / "corpus"
OUTCOMES = dict(re.findall(r"^\| (\S+\.\w+) \| (\w+) \|", (CORPUS / "README.md").read_text(), re.MULTILINE))


def test_every_file_is_told_of(fuzz_readers):
    assert {path.name for path in fuzz_readers.seeds()} == set(OUTCOMES)


@pytest.mark.parametrize("name", OUTCOMES)
def test_what_comes_of_it(fuzz_readers, name):
    assert fuzz_readers.outcome(name, (CORPUS / name).read_bytes(), whole=True) == OUTCOMES[name]


def test_damaged_files(fuzz_readers):
    """A few of those that ``bench fuzz readers`` plays."""
    outcomes = {fuzz_readers.play(number, False) for number in range(600)}
    assert outcomes == {"refused", "faulty", "made"}


def test_a_mutant_can_be_played_again(fuzz_readers):
    assert [fuzz_readers.mutant(n) for n in (3, 17, 12345)] == [fuzz_readers.mutant(n) for n in (3, 17, 12345)]


def test_spoilt_meshes(fuzz_meshes):
    """A few of those that ``bench fuzz meshes`` plays: what passes the checks is made, or refused in a sentence."""
    outcomes = {fuzz_meshes.play(number, True) for number in range(12)}
    assert outcomes >= {"faulty", "made"}
