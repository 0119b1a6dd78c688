"""Colours: one per patch that sit well beside each other, and scales for numbers. Linear RGB, as Blender wants it; sRGB in files."""

from __future__ import annotations

import numpy as np

# scales from low to high, sRGB, chosen by eye: darker is more, so that they can be told apart without colour too
# how bad something is
BAD = np.array([[0.93, 0.95, 0.92], [0.98, 0.86, 0.50], [0.93, 0.48, 0.24], [0.66, 0.09, 0.20]])
# how much there is of something
MUCH = np.array([[0.96, 0.95, 0.85], [0.55, 0.80, 0.68], [0.18, 0.52, 0.60], [0.13, 0.22, 0.42]])
SEAM = np.array([0.10, 0.11, 0.14])  # of cuts, sRGB: nearly black, beside every colour of a patch
# what may limit a match -> its colour, sRGB, and what the legend says
LIMITS: dict[str, tuple[tuple[float, float, float], str]] = {
    "matched": ((0.90, 0.92, 0.88), "matches"),
    "softest": ((0.90, 0.45, 0.13), "as soft as it may be"),
    "stiffest": ((0.50, 0.27, 0.60), "as stiff as it may be"),
    "unstable": ((0.76, 0.08, 0.20), "about to snap"),
    "distorted": ((0.95, 0.78, 0.25), "distorted by flattening"),
    "stretched": ((0.14, 0.55, 0.55), "stretched in its plane"),
    "free": ((0.40, 0.58, 0.85), "pulled by its neighbours"),
}
UNSEEN = np.array([0.62, 0.62, 0.62])  # what was not measured: a grey that no scale has; by eye
LEAST_DISTANCE = 0.1  # mm: the scale of distances reaches at least to here, or rounding errors would be coloured


def linear(srgb: np.ndarray) -> np.ndarray:
    """Linear from sRGB, any shape, values in [0, 1]."""
    srgb = np.asarray(srgb, dtype=float)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def hexadecimal(rows: np.ndarray) -> list[str]:
    """Linear RGB (N, 3) as "#rrggbb", which is sRGB."""
    srgb = np.where(rows <= 0.0031308, 12.92 * rows, 1.055 * np.maximum(rows, 0.0) ** (1 / 2.4) - 0.055)
    return ["#" + "".join(f"{round(255 * min(max(x, 0.0), 1.0)):02x}" for x in row) for row in srgb.tolist()]


def oklch(lightness: np.ndarray, chroma: np.ndarray, hue: np.ndarray) -> np.ndarray:
    """(N, 3) linear RGB of colours of equal perceived lightness; hue in radians (Ottosson 2020, Oklab)."""
    a, b = chroma * np.cos(hue), chroma * np.sin(hue)
    cone = np.stack(
        [
            lightness + 0.3963377774 * a + 0.2158037573 * b,
            lightness - 0.1055613458 * a - 0.0638541728 * b,
            lightness - 0.0894841775 * a - 1.2914855480 * b,
        ],
        axis=-1,
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return np.clip(cone**3 @ to_rgb.T, 0.0, 1.0)


def of_patches(count: int) -> np.ndarray:
    """(count, 3) linear RGB: soft colours, consecutive ones far apart in hue (golden angle)."""
    i = np.arange(count)
    return oklch(0.76 + 0.05 * np.cos(2.4 * i), np.full(count, 0.095), 0.9 + 2.399963 * i)


def of_seams(count: int) -> np.ndarray:
    """(count, 3) linear RGB: stronger colours, so that the two sides of a seam find each other."""
    i = np.arange(count)
    return oklch(np.full(count, 0.58), np.full(count, 0.16), 0.4 + 2.399963 * i)


def on_scale(values: np.ndarray, low: float, high: float, scale: np.ndarray) -> np.ndarray:
    """(N, 3) linear RGB: values between low and high on a scale (n, 3) of sRGB anchors."""
    span = high - low
    t = np.clip((values - low) / span, 0.0, 1.0) if span > 0 else np.zeros(len(values))
    anchors = np.linspace(0.0, 1.0, len(scale))
    return linear(np.stack([np.interp(t, anchors, scale[:, k]) for k in range(3)], axis=1))
