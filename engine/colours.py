"""Colours of patches and seams, and colour scales for values. Linear RGB, as Blender expects, unless sRGB is stated."""

from __future__ import annotations

import numpy as np

from .arrays import Float

# Colour scale for errors, strains and other values that should be low: sRGB colours from low to high, chosen by eye.
# This scale and QUANTITY_SCALE get darker with the value, so that they work in greyscale too
ERROR_SCALE = np.array([[0.93, 0.95, 0.92], [0.98, 0.86, 0.50], [0.93, 0.48, 0.24], [0.66, 0.09, 0.20]])
# Colour scale for neutral quantities: sRGB colours from low to high, chosen by eye
QUANTITY_SCALE = np.array([[0.96, 0.95, 0.85], [0.55, 0.80, 0.68], [0.18, 0.52, 0.60], [0.13, 0.22, 0.42]])
SEAM = np.array([0.10, 0.11, 0.14])  # colour of cuts, sRGB: nearly black, to stand out from all patches
# for each reason why a spiral misses its target (``optimisation.match_limits.REASONS``): sRGB colour, text in the key
LIMITS: dict[str, tuple[tuple[float, float, float], str]] = {
    "matched": ((0.90, 0.92, 0.88), "matches"),
    "softest": ((0.90, 0.45, 0.13), "as soft as it may be"),
    "stiffest": ((0.50, 0.27, 0.60), "as stiff as it may be"),
    "unstable": ((0.76, 0.08, 0.20), "about to snap"),
    "distorted": ((0.95, 0.78, 0.25), "distorted by flattening"),
    "stretched": ((0.14, 0.55, 0.55), "stretched in its plane"),
    "free": ((0.40, 0.58, 0.85), "pulled by its neighbours"),
}
MISSING_GREY = np.array([0.62, 0.62, 0.62])  # colour of missing values: a grey that is not on any scale; by eye
LEAST_DISTANCE = 0.1  # mm, smallest upper end of the scale of distances: with less, rounding errors would be coloured
LEAST_ANISOTROPY = 1.0  # percent, smallest upper end of the scale of anisotropy: with less, rounding would be coloured
LEAST_SLOT = 0.3  # mm, smallest upper end of the scale of slot widths: the narrowest slot that a laser cuts
LIGHT = np.array([0.27, -0.45, 0.85])  # unit vector towards the light: enough shade to see the shape; by eye


def srgb_to_linear(srgb: np.ndarray) -> np.ndarray:
    """Convert sRGB to linear RGB; any shape, values in [0, 1]."""
    srgb = np.asarray(srgb, dtype=float)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def to_hexadecimal(rows: np.ndarray) -> list[str]:
    """Format linear RGB colours (N, 3) as sRGB texts "#rrggbb"."""
    srgb = np.where(rows <= 0.0031308, 12.92 * rows, 1.055 * np.maximum(rows, 0.0) ** (1 / 2.4) - 0.055)
    return ["#" + "".join(f"{round(255 * min(max(x, 0.0), 1.0)):02x}" for x in row) for row in srgb.tolist()]


def oklch_to_linear(lightness: np.ndarray, chroma: np.ndarray, hue: np.ndarray) -> np.ndarray:
    """Convert colours from Oklch (Ottosson 2020), in which colours of equal lightness look equally light.

    Parameters
    ----------
    lightness, chroma : (N,)
    hue : (N,) radians

    Returns
    -------
    (N, 3) linear RGB, clipped to [0, 1]
    """
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


def patch_colours(count: int) -> np.ndarray:
    """Return soft colours (count, 3), linear RGB; consecutive colours are far apart in hue (golden angle)."""
    i = np.arange(count)
    return oklch_to_linear(0.76 + 0.05 * np.cos(2.4 * i), np.full(count, 0.095), 0.9 + 2.399963 * i)


def seam_colours(count: int) -> np.ndarray:
    """Return strong colours (count, 3), linear RGB, by which people find both sides of a seam."""
    i = np.arange(count)
    return oklch_to_linear(np.full(count, 0.58), np.full(count, 0.16), 0.4 + 2.399963 * i)


def interpolate_scale(share: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Interpolate sRGB colours (N, 3) of a scale.

    Parameters
    ----------
    share : (N,) from 0 to 1, the start and the end of the scale
    scale : (n, 3) sRGB colours at equal distances
    """
    anchors = np.linspace(0.0, 1.0, len(scale))
    return np.stack([np.interp(share, anchors, scale[:, k]) for k in range(3)], axis=-1)


def map_to_scale(values: np.ndarray, low: float, high: float, scale: np.ndarray) -> np.ndarray:
    """Map values to colours.

    Parameters
    ----------
    values : (N,)
    low, high : ends of the scale, in the unit of the values
    scale : (n, 3) sRGB colours at equal distances from low to high

    Returns
    -------
    (N, 3) linear RGB
    """
    span = high - low
    t = np.clip((values - low) / span, 0.0, 1.0) if span > 0 else np.zeros(len(values))
    return srgb_to_linear(interpolate_scale(t, scale))


def mix_with_white(scale: Float[np.ndarray, "anchors 3"]) -> Float[np.ndarray, "anchors 3"]:
    """Mix a colour scale half and half with white, so that dark lines and arms stand out on it."""
    return 0.5 + 0.5 * scale
