"""The stroke font."""

import numpy as np
import pytest
from flexmaps.engine.fabrication.panels.lettering import curved_text, straight_text, text_length, text_strokes

LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-."


@pytest.mark.parametrize("letter", LETTERS)
def test_every_letter_stands_in_its_box(letter):
    drawn = np.vstack(text_strokes(letter))
    assert drawn.min() >= 0.0
    assert drawn[:, 0].max() <= text_length(letter) + 1e-12
    assert drawn[:, 1].max() <= 1.0


def test_letters_differ():
    shapes = {letter: tuple(map(tuple, np.vstack(text_strokes(letter)))) for letter in LETTERS}
    assert len(set(shapes.values())) == len(LETTERS)


def test_letters_follow_each_other_without_touching():
    a, b = text_strokes("H"), text_strokes("HH")[2 * len(text_strokes("H")) // 2 :]
    assert np.vstack(b)[:, 0].min() > np.vstack(a)[:, 0].max() + 0.1


def test_straight_text_is_centred_and_turned():
    drawn = np.vstack(straight_text("H", 2.0, np.array([5.0, 5.0]), np.array([0.0, 1.0])))
    np.testing.assert_allclose(0.5 * (drawn.min(axis=0) + drawn.max(axis=0)), [5.0, 5.0])
    np.testing.assert_allclose(np.ptp(drawn, axis=0), [2.0, 1.2])


def test_text_along_a_circle_stays_within_its_height():
    angle = np.linspace(0, np.pi, 721)
    circle = 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    drawn = np.vstack(curved_text("A12", 0.5, circle, 3.0))
    radius = np.linalg.norm(drawn, axis=1)
    assert radius.min() > 2.749
    assert radius.max() < 3.251
    middle = np.arctan2(*drawn.mean(axis=0)[::-1])
    assert middle == pytest.approx(1.0, abs=0.05)


def test_unknown_letters_are_left_blank():
    assert text_strokes("?") == []
    assert len(text_strokes("A?B")) == len(text_strokes("AB"))
