"""Render pictures and films in a second Blender, because a render blocks the Blender that it runs in."""

from __future__ import annotations

import re
import time
from pathlib import Path

from ...engine.errors import FlexMapsError
from ...engine.progress import Progress
from .background import POLL_INTERVAL
from .second_blender import start_blender

SCRIPT = Path(__file__).with_name("second_render_script.py")
SAMPLE_PATTERN = re.compile(rb"Sample (\d+)/(\d+)")
TAIL_BYTES = 4000  # bytes at the end of the log in which the last progress line (about 150 bytes) is searched


def render(pack: Path, out: Path, frames: int, progress: Progress) -> list[Path]:
    """Render the first scene of a .blend file, and return the files written into the folder ``out``.

    The scene's output path has to lie in ``out``.

    Parameters
    ----------
    pack : the .blend file
    out : the folder
    frames : number of frames of a film; 0 for a picture
    progress : called with a fraction and a text; if it raises, the render is killed

    Raises
    ------
    FlexMapsError : the render fails
    """
    out.mkdir(exist_ok=True)
    log = pack.with_suffix(".txt")
    with log.open("wb") as stream:
        process = start_blender(pack.parent, SCRIPT, (str(pack), "film" if frames else "picture"), stream)
        try:
            while process.poll() is None:
                progress(*_read_progress(log, out, frames))
                time.sleep(POLL_INTERVAL)
        finally:
            process.kill()
            process.wait()
            if process.stdin is not None:
                process.stdin.close()
    pictures = sorted(one for one in out.iterdir() if one.is_file())
    if process.returncode or not pictures:
        lines = log.read_text(errors="replace").strip().splitlines()
        raise FlexMapsError(f"The picture could not be made: {lines[-1] if lines else 'the second Blender broke off'}")
    return pictures


def _read_progress(log: Path, out: Path, frames: int) -> tuple[float, str]:
    """Return the fraction done and a progress text, from the render's log or the number of files in ``out``."""
    if frames:
        done = sum(1 for _ in out.iterdir())
        return min(done / frames, 1.0), f"frame {min(done + 1, frames)} of {frames}"
    samples = SAMPLE_PATTERN.findall(log.read_bytes()[-TAIL_BYTES:])
    if not samples:
        return 0.0, "setting up the picture"
    done, count = (int(word) for word in samples[-1])
    return done / max(count, 1), f"sample {done} of {count}"
