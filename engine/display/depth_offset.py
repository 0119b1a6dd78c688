"""Pull what is drawn on a surface towards the eye, so that the surface does not show through it."""

from __future__ import annotations

import numpy as np

from ..arrays import Float

# Offset in steps of a 24-bit depth buffer. Rounding moves depths by up to two steps. Smaller: the surface shows through
# in speckles; larger: things closely behind an edge show through
STEPS = 4


def pull_forward(projection: Float[np.ndarray, "4 4"], times: float = 1.0) -> Float[np.ndarray, "4 4"]:
    """Return a projection that draws everything nearer to the eye by a few steps of the depth buffer.

    The offset is constant in the depth buffer, not in space: the steps of the buffer become coarser with the distance
    and with the clip range. So the offset suffices in every unit of length, in perspective and orthographic views.

    Parameters
    ----------
    projection : projection matrix, from the eye's axes to clip space
    times : offset in multiples of ``STEPS``; above 1 for what is drawn on top of something that is offset itself
    """
    pulled = np.array(projection, dtype=float)
    pulled[2] -= times * STEPS * 2.0**-23 * pulled[3]  # clip space is 2 deep, from -w to w
    return pulled
