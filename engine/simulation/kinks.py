"""Findings about joints at which unlike arms meet in a kink, where computed strains are less sure."""

from __future__ import annotations

import numpy as np

from ..arrays import Float
from ..materials import OVERSTRAIN_SHARE, Material
from ..mechanics.arms.strain_changes import KINK_LIMIT, KINK_STRAIN_FACTOR, kink_sharpness
from ..mechanics.assembly import Assembly
from ..surface.checking.finding import Finding, with_count


def kink_findings(assembly: Assembly, joint_strain: Float[np.ndarray, "joints 2"], material: Material) -> list[Finding]:
    """Return a finding about joints at kinks where the computed strain is allowed but the true one may not be.

    Parameters
    ----------
    assembly : spirals and joints
    joint_strain : largest surface strain of both arms of every joint
    material : gives the strain limit
    """
    share = joint_strain.max(axis=1) / material.strain_limit
    share = np.where(kink_sharpness(assembly) < KINK_LIMIT, 0.0, share)
    doubtful = (share <= OVERSTRAIN_SHARE) & (KINK_STRAIN_FACTOR * share > OVERSTRAIN_SHARE)
    if not doubtful.any():
        return []
    spirals = np.unique(assembly.pairs[doubtful])
    spirals = spirals[spirals < assembly.spirals]
    most = 100.0 * float(share[doubtful].max())
    text = (
        f"Arms of {with_count(len(spirals), 'spiral', 'spirals')} meet unlike arms in a kink, where strains are less sure: the computed strain is {most:.0f} % "
        f"of {material.bears}, the true one can be up to {KINK_STRAIN_FACTOR * most:.0f} %. To be sure, smooth these spirals with the brush Twist and Shift, then simulate"
    )
    return [Finding("kinked", "warning", text, tuple(spirals.tolist()))]
