"""Which cuts are the best: many layouts judged by the shape that their panels take, the proposals as a table, and another one taken.

    blender -b --python examples/17_choose_a_layout.py -- surface.obj 4

The words are a mesh (or shape:NAME) and the most panels that there may be.
"""

import sys

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api


def main(words: list, settings: dict = {}) -> list:  # noqa: B006
    """Print the proposals, and return their figures."""
    source, most = words[0] if words else "shape:torus", int(words[1]) if len(words) > 1 else 4
    piece = api.choose(api.load(source, edge=20, settings=settings), panels=most)
    choice = piece.result.choice
    print(choice.note)
    for number, proposal in enumerate(choice.proposals):
        row = proposal.report()
        mark = "*" if number == choice.taken else " "
        print(f"{mark} {row['panels']} panels, {row['joints']} joints, RMS {row['rms_percent']:.3f} %, {row['origin']}")
    least = min(range(len(choice.proposals)), key=lambda k: choice.proposals[k].report()["joints"])
    quick = api.take(piece, least)  # the least work, whatever it looks like
    print(f"panels of the one with the least work: {len(quick.result.flat.layout.patches)}")
    return [proposal.report() for proposal in choice.proposals]


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
