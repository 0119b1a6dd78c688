"""``demo`` and ``run`` of tools/dev.py: the main job of the package."""

from __future__ import annotations

import os
import sys

DEMO = ["shape:demo", "--out", "out"]


def main(argv: list[str]) -> int:
    """``demo`` runs on the project's own surface unless other arguments are given; ``run`` takes all of them."""
    import flexmaps
    from flexmaps.bridge import main_job

    flexmaps.register()  # so that the .blend carries the settings of the run
    command, *rest = argv
    status = main_job.main(DEMO + rest if command == "demo" else rest)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # Blender as a module frees its memory after its own leak detector, which then complains for pages
