"""Four arms of four widths: what the optimiser makes of them, and a plate that is made softer one way by hand.

    blender -b --python examples/16_four_widths.py -- shape:saddle

The word is a mesh (or shape:NAME). Column k of the widths is the arm that ends at side k of its quad, so that 0 and 2 are opposite.
"""

import sys

import numpy as np

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api

COLUMNS, ROWS = 8, 4


def anisotropy(width: np.ndarray) -> np.ndarray:
    """How unlike the two pairs of opposite arms are, from 0 to 1, of widths (quads, 4)."""
    pairs = width[:, :2] + width[:, 2:]
    return abs(pairs[:, 0] - pairs[:, 1]) / pairs.sum(axis=1)


def optimised(source: str, settings: dict) -> np.ndarray:
    """Widths in millimetres, four a quad, of a surface whose arms may each have their own."""
    piece = api.optimise(api.load(source, edge=20, settings={"optimise.arms": "each", **settings}))
    return 1e3 * piece.result.design.width


def softer(piece: "api.Piece", sides: tuple, millimetres: float) -> "api.Piece":
    """The same piece with thinner arms at two sides of every quad: written to its object in Blender, as painting them would."""
    obj = api.show(piece)
    width = obj.data.attributes["flexmaps_width"].data  # one a corner, in the order of the sides
    for face in obj.data.polygons:
        for side in sides:
            width[face.loop_start + side].value = millimetres
    return api.load(obj, settings=piece.settings)


def sag(piece: "api.Piece") -> float:
    """Millimetres by which it hangs lower than it was drawn."""
    made = api.simulate(piece, supports=range(ROWS))  # the quads at one end are held
    return -1e3 * made.result.simulation.vertices[:, 2].min()


def main(words: list, settings: dict = {}) -> dict:  # noqa: B006
    """Print what was found, and return it."""
    width = optimised(words[0] if words else "shape:saddle", settings)
    print(f"arms {width.min():.2f} to {width.max():.2f} mm wide; in the middle of all spirals one pair of arms")
    print(
        f"is {np.median(anisotropy(width)):.1%} of both wider than the other, at the most {anisotropy(width).max():.1%}"
    )

    x, y = np.meshgrid(0.02 * np.arange(COLUMNS + 1), 0.02 * np.arange(ROWS + 1), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(COLUMNS + 1, ROWS + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    plate = api.load(api.QuadMesh(points, quads), settings={"simulate.gravity": True})
    plate = api.spirals(plate)
    found = {
        "even": sag(plate),
        "softer along": sag(softer(plate, (1, 3), 1.0)),  # sides 1 and 3 of these quads are crossed on the way along x
        "softer across": sag(softer(plate, (0, 2), 1.0)),
    }
    for name, millimetres in found.items():
        print(f"{name:14} it sags by {millimetres:.3f} mm")
    return found


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
