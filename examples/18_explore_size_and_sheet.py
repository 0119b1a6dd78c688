"""Which size and which sheet? Many candidates tried on all cores, those worth choosing among as a table, and the best one taken.

    blender -b --python examples/18_explore_size_and_sheet.py -- shape:strip 8

The first word is a mesh (or shape:NAME), the second how many candidates are tried. Everything lies in out/explored; called
again with more of them, it goes on there.
"""

import sys

try:
    from bl_ext.user_default.flexmaps import api
except ImportError:  # Blender as a Python module, from a checkout
    from flexmaps import api


def main(words: list) -> "api.Piece":
    """Explore, print the front, and return the piece in size and settings of the best candidate."""
    source, count = words[0], int(words[1])
    piece = api.layout(api.load(source, edge=20))
    vary = {"edge": "12:30", "spiral.thickness": "1:3", "material.material": ["pom", "birch"]}
    goals = ("rms_percent<=2", "strain_share<=0.91", "sheets<=2")
    found = api.explore(piece, vary, "out/explored", candidates=count, goals=goals)
    for one in found.front:
        print(one.values, f"RMS {one.measures['rms_percent']} %, strain {one.measures['strain_share']} of the limit")
    print(found.note)
    if found.best is None:
        return piece
    return api.use(piece, found.candidates[found.best].values)


if __name__ == "__main__":
    piece = main(sys.argv[sys.argv.index("--") + 1 :])
