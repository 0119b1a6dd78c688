"""How joints answer to second order: what the curving of their arms adds to the strains of the arm model.

Two joined arms are one inextensible elastic curve x(s) from hub to hub (Kirchhoff). Its sections turn by a field of
rotation vectors phi(s), seen from the frame half way between the hubs, with phi = -turn/2 and +turn/2 at the ends. With

    curvature = phi' - phi x phi' / 2,     gap = integral of phi x dx + integral of phi x (phi x dx) / 2

to second order, and because the energy's third order needs the fields' first order alone (Wigner's 2n + 1 theorem), the
energy of a joint is e'.K e' / 2 with the corrected strains e' = e + e.D.e,

    shift' = shift - integral of phi x (phi x dx) / 2 - integral of (phi x phi') x l ds / 2
    turn'  = turn - integral of phi x phi' ds / 2

where l is the way from x to the middle between the hubs, and phi' = c (moment + l x force) with the compliance c of the
arm's section. The linear wrench is K e.
"""

from __future__ import annotations

import numpy as np

from .assembly import Assembly
from .beams import torsion_constant
from .materials import Material

POINTS = 16
HUB = 0.55
"""Where an arm begins to bend, in its widths from the centre of the hub."""

_X, _W = np.polynomial.legendre.leggauss(POINTS)
_NODES, _WEIGHTS = 0.5 * (_X + 1.0), 0.5 * _W


def _running() -> np.ndarray:
    """(POINTS, POINTS): integral from 0 to node i of the polynomial that is 1 at node j and 0 at the others."""
    legendre = np.polynomial.legendre
    series = [legendre.legint(one, lbnd=-1) for one in np.eye(POINTS)]
    integrals = 0.5 * np.stack([legendre.legval(_X, one) for one in series], axis=1)
    return integrals @ np.linalg.inv(legendre.legvander(_X, POINTS - 1))


def _skew(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) that takes x to v x x."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


_RUNNING = _running()
_EYE = np.eye(3)
_LEVI = np.stack([_skew(one[None])[0] for one in _EYE], axis=1)  # [i, j, k] of a x b = LEVI a b


def second_order_strains(
    assembly: Assembly, material: Material, stiffness: np.ndarray, lever: np.ndarray
) -> np.ndarray:
    """(m, 6, 6, 6) D, symmetric in its last two axes: the strains' second order, e' = e + e.D.e, for every joint.

    stiffness (m, 6, 6) and lever (m, 2, 3), the way from the hubs to the points between which the shift is measured, are
    those of ``ArmModel``; strains as there: shift (m) and turn (rad) in the joint's axes.
    """
    held = np.einsum("ekji,ekj->eki", assembly.axes, lever)
    # the shift between the centres, and from it the one between the levers' ends, which adds turn x (sum of levers) / 2 ...
    from_centres = np.broadcast_to(np.eye(6), stiffness.shape).copy()
    from_centres[:, :3, 3:] = -0.5 * _skew(held[:, 0] + held[:, 1])
    of_centres = _of_centres(assembly, material, np.swapaxes(from_centres, 1, 2) @ stiffness @ from_centres)
    back = np.linalg.inv(from_centres)
    found = (from_centres @ of_centres.reshape(-1, 6, 36)).reshape(-1, 6, 6, 6)
    found = np.swapaxes(back, 1, 2)[:, None] @ found @ back[:, None]
    # ... and, to second order, turn x (turn x (difference of levers)) / 8, which needs no correction any more
    apart = 0.125 * (held[:, 1] - held[:, 0])
    twice = np.einsum("ia,eb->eiab", _EYE, apart) - np.einsum("ei,ab->eiab", apart, _EYE)
    found[:, :3, 3:, 3:] -= 0.5 * (twice + np.swapaxes(twice, 2, 3))
    return found


def _of_centres(assembly: Assembly, material: Material, stiffness: np.ndarray) -> np.ndarray:
    """The same with the shift between the hubs' centres."""
    x, rim, step, bend, length = _arms(assembly, material)
    lever = np.einsum("ekji,ekj->eki", assembly.axes, assembly.lever)
    # the origin is the middle between the hubs' centres
    middle = 0.5 * (lever[:, 0] + lever[:, 1])
    centre = middle[:, None] - lever
    arm = -(centre[:, :, None] + x)
    moment = np.concatenate([_skew(arm), np.broadcast_to(_EYE, (*arm.shape[:-1], 3, 3))], axis=-1)
    half_turn = np.concatenate([np.zeros((3, 3)), 0.5 * _EYE], axis=1)
    curve = bend @ moment @ stiffness[:, None, None]
    # the solid's own stiffness differs a little from the beam's: what is left of the turn is spread along the arms
    left = 2.0 * half_turn - np.einsum("ekgij->eij", curve)
    curve += (length / length.sum(axis=(1, 2), keepdims=True))[..., None, None] * left[:, None, None]
    running = _RUNNING / _WEIGHTS
    field = np.einsum("gh,ekhij->ekgij", running, curve) - half_turn
    m, sign = len(x), np.array([1.0, -1.0])[:, None, None]
    # with the hubs' rigid parts as one more station each
    fields = np.concatenate([field, np.broadcast_to(-half_turn, (m, 2, 1, 3, 6))], axis=2).reshape(m, -1, 3, 6)
    steps = (sign * np.concatenate([step, rim[:, :, None]], axis=2)).reshape(m, -1, 3)
    along = np.einsum("egja,egj->ega", fields, steps)
    inner = np.swapaxes(fields, 2, 3) @ fields
    flat = fields.reshape(m, len(fields[0]), 18)
    bowing = (np.swapaxes(flat, 1, 2) @ along).reshape(m, 3, 6, 6)
    bowing -= (np.swapaxes(steps, 1, 2) @ inner.reshape(m, -1, 36)).reshape(m, 3, 6, 6)
    out = np.empty((m, 6, 6, 6))
    curve, field, arm = (
        (sign[..., None] * curve).reshape(m, -1, 18),
        field.reshape(m, -1, 3, 6),
        arm.reshape(m, -1, 3),
    )
    flat = field.reshape(m, -1, 18)
    both = (np.swapaxes(flat, 1, 2) @ curve).reshape(m, 3, 6, 3, 6)
    out[:, 3:] = -0.5 * np.einsum("ijk,ejakb->eiab", _LEVI, both)
    # (phi x phi') x l = phi' (phi.l) - phi (phi'.l)
    by_field = np.einsum("egja,egj->ega", field, arm)
    by_curve = np.einsum("egja,egj->ega", curve.reshape(field.shape), arm)
    first = np.swapaxes(np.swapaxes(curve, 1, 2) @ by_field, 1, 2).reshape(m, 6, 3, 6).transpose(0, 2, 1, 3)
    second = (np.swapaxes(flat, 1, 2) @ by_curve).reshape(m, 3, 6, 6)
    out[:, :3] = -0.5 * (bowing + first - second)
    return 0.5 * (out + np.swapaxes(out, 2, 3))


def _arms(assembly: Assembly, material: Material) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stations of both arms of every joint, in the joint's axes, seen from the hub's centre.

    Places (m, 2, N, 3) m, the rim (m, 2, 3) m where bending begins, the step (m, 2, N, 3) m outwards and the length
    (m, 2, N) m that a station stands for, and the turn per moment (m, 2, N, 3, 3) rad/(N m) over it.
    """
    radius, axes = assembly.radius, assembly.radial
    width, twist = assembly.width[assembly.pairs], assembly.twist[assembly.pairs]
    side = -1.0 if assembly.clockwise else 1.0
    begin = np.minimum(HUB * width / radius, 0.5)[..., None]
    u = begin + (1.0 - begin) * _NODES
    weight = (1.0 - begin) * _WEIGHTS * radius[..., None]
    wind = twist[..., None] * (1.0 - u)
    cosine, sine, lean = np.cos(wind), np.sin(wind), twist[..., None] * u

    def placed(along: np.ndarray, left: np.ndarray) -> np.ndarray:
        return along[..., None] * axes[:, :, None, :, 0] + side * left[..., None] * axes[:, :, None, :, 1]

    place = placed(radius[..., None] * u * cosine, radius[..., None] * u * sine)
    velocity = placed(cosine + lean * sine, sine - lean * cosine)
    speed = np.sqrt(1.0 + lean**2)
    start = twist[..., None] * (1.0 - begin)
    rim = placed(radius[..., None] * begin * np.cos(start), radius[..., None] * begin * np.sin(start))[:, :, 0]
    tangent = velocity / speed[..., None]
    normal = np.broadcast_to(axes[:, :, None, :, 2], tangent.shape)
    aside = np.cross(normal, tangent)
    torsion = torsion_constant(assembly.thickness / width)[0] * width**4 * 0.5 / (1.0 + material.poisson)
    inertias = (torsion, width * assembly.thickness**3 / 12.0, assembly.thickness * width**3 / 12.0)
    length = weight * speed
    bend = sum(
        (length / (material.youngs * inertia[..., None]))[..., None, None] * axis[..., :, None] * axis[..., None, :]
        for inertia, axis in zip(inertias, (tangent, aside, normal))
    )
    return place, rim, velocity * weight[..., None], np.asarray(bend), length
