"""Pictures and films rendered by a second Blender, while the first one goes on: a render blocks the Blender that it runs in."""

from __future__ import annotations

import re
import time
from pathlib import Path

from ...engine.errors import FlexMapsError
from ...engine.progress import Progress
from .second_blender import LOOK, started

SCRIPT = Path(__file__).with_name("second_render_script.py")
SAMPLE = re.compile(rb"Sample (\d+)/(\d+)")
TAIL = 4000  # bytes of what it prints in which the last line of its progress is looked for; a line has some 150


def render(pack: Path, made: Path, frames: int, progress: Progress) -> list[Path]:
    """Render the scene of a file; returns the files that it wrote into the folder ``made``.

    frames : of a film; 0 for a picture. Raises ``FlexMapsError`` where it fails, and whatever ``progress`` raises, which ends it.
    """
    made.mkdir(exist_ok=True)
    log = pack.with_suffix(".txt")
    with log.open("wb") as stream:
        process = started(pack.parent, SCRIPT, (str(pack), "film" if frames else "picture"), stream)
        try:
            while process.poll() is None:
                progress(*_told(log, made, frames))
                time.sleep(LOOK)
        finally:
            process.kill()
            process.wait()
            if process.stdin is not None:
                process.stdin.close()
    found = sorted(one for one in made.iterdir() if one.is_file())
    if process.returncode or not found:
        said = log.read_text(errors="replace").strip().splitlines()
        raise FlexMapsError(f"The picture could not be made: {said[-1] if said else 'the second Blender broke off'}")
    return found


def _told(log: Path, made: Path, frames: int) -> tuple[float, str]:
    """How far it is, by what it prints and has written."""
    if frames:
        done = sum(1 for _ in made.iterdir())
        return min(done / frames, 1.0), f"frame {min(done + 1, frames)} of {frames}"
    samples = SAMPLE.findall(log.read_bytes()[-TAIL:])
    if not samples:
        return 0.0, "setting up the picture"
    done, count = (int(word) for word in samples[-1])
    return done / max(count, 1), f"sample {done} of {count}"
