"""``demo`` and ``run`` of tools/dev.py: the main job of the package."""

from __future__ import annotations

# arms that meet no other one are left out: the piece takes the same shape, and its border ends in a line instead of stubs
DEMO = ["shape:demo", "--optimise", "--supports", "lowest", "--set", "spiral.border=left_out", "--out", "out"]


def main(argv: list[str]) -> int:
    """``demo`` runs on the project's own surface unless other arguments are given; ``run`` takes all of them."""
    import flexmaps
    from flexmaps.command import main as command

    flexmaps.register()  # so that the .blend carries the settings of the run
    name, *rest = argv
    return command.main(["run", *(DEMO if name == "demo" else []), *rest])
