"""Pull what is drawn on a surface towards the eye, so that the surface does not show through it."""

from __future__ import annotations

import numpy as np

from ..arrays import Float

# Offset in steps of a 24-bit depth buffer. Rounding moves depths by up to two steps, so fewer let the surface speckle through;
# more show colours of what lies closely behind an edge
STEPS = 4


def pull_forward(projection: Float[np.ndarray, "4 4"], times: float = 1.0) -> Float[np.ndarray, "4 4"]:
    """Return a projection that draws everything nearer to the eye by a few steps of the depth buffer.

    The offset is constant in the depth buffer, not in space: a buffer's steps become coarser with the distance and with the clip
    range. So it is enough in every unit of length, in perspective and orthographic.

    Parameters
    ----------
    projection : projection matrix, from the eye's axes to clip space
    times : how many times ``STEPS``, for what is drawn on top of something pulled
    """
    pulled = np.array(projection, dtype=float)
    pulled[2] -= times * STEPS * 2.0**-23 * pulled[3]  # clip space is 2 deep, from -w to w
    return pulled
