"""A second Blender without a window, which runs remeshing tools: QuadriFlow, voxel remesh and others.

QuadriFlow blocks the Blender that it runs in. After one ESC it reports "cancelled" for the rest of the session, and on
some surfaces it never returns. A separate process can be watched and killed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...engine.errors import FlexMapsError
from ...engine.progress import SILENT, Progress
from ...engine.surface.mesh import PolygonMesh
from .background import POLL_INTERVAL

SCRIPT = Path(__file__).with_name("second_blender_script.py")
# timeout of a request, seconds (runs take up to 3 s); a longer one suits slower machines, and waits longer for runs
# that never end
TIMEOUT = 30.0
START_TIMEOUT = 120.0  # seconds added to the timeout if Blender has to start (about 4 s); longer suits slower machines
# folders of Blender's user files that are set by environment variables BLENDER_USER_...
USER_FILES = ("RESOURCES", "CONFIG", "SCRIPTS", "EXTENSIONS", "DATAFILES")


class SecondBlender:
    """Implementation of the remeshing tools that ``engine.surface.remeshing.requad`` needs.

    Use it in a ``with`` statement, which ends the process.

    Parameters
    ----------
    smooth : whether QuadriFlow smooths the normals first
    """

    def __init__(self, smooth: bool = False):
        self._smooth = smooth
        self._process: subprocess.Popen[str] | None = None
        self._asked = 0

    def __enter__(self) -> SecondBlender:
        self._folder = tempfile.TemporaryDirectory(prefix="flexmaps-")
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        self._folder.cleanup()

    def triangles(self, mesh: PolygonMesh, near: float, progress: Progress = SILENT) -> PolygonMesh | None:
        made = self._mesh("triangles", mesh, {"near": near}, progress)
        if made is None and self._process is None:
            raise FlexMapsError(
                "The second Blender, which the quad remesh needs, did not start or broke off; try again"
            )
        return made

    def quads(
        self, body: PolygonMesh, count: int, seed: int, sharp: bool, progress: Progress = SILENT
    ) -> PolygonMesh | None:
        options = {"count": count, "seed": seed, "sharp": sharp, "smooth": self._smooth}
        return self._mesh("quads", body, options, progress)

    def voxels(self, body: PolygonMesh, size: float, progress: Progress = SILENT) -> PolygonMesh | None:
        return self._mesh("voxels", body, {"size": size}, progress)

    def cells(self, body: PolygonMesh, size: float, progress: Progress = SILENT) -> PolygonMesh | None:
        return self._mesh("cells", body, {"size": size}, progress)

    def intersecting_pairs(self, parts: list[PolygonMesh], progress: Progress = SILENT) -> list[tuple[int, int]]:
        first = np.cumsum([0, *(len(part.vertices) for part in parts)])
        arrays = {
            "vertices": np.concatenate([part.vertices for part in parts]),
            "corners": np.concatenate([part.corners + k for part, k in zip(parts, first, strict=False)]),
            "body": np.repeat(np.arange(len(parts)), [len(part.sizes) for part in parts]),
        }
        answered = self._ask("touching", arrays, {}, progress)
        return [] if answered is None else [(int(a), int(b)) for a, b in answered["pairs"]]

    # -- the process ---------------------------------------------------------------------------------------------------

    def _mesh(self, tool: str, mesh: PolygonMesh, options: dict[str, Any], progress: Progress) -> PolygonMesh | None:
        inputs = {"vertices": mesh.vertices, "corners": mesh.corners, "sizes": mesh.sizes}
        arrays = self._ask(tool, inputs, options, progress)
        if not arrays:
            return None
        corners, sizes = arrays["corners"].astype(np.int64), arrays["sizes"].astype(np.int64)
        return PolygonMesh(arrays["vertices"].astype(float), corners, sizes)

    def _ask(
        self, tool: str, arrays: dict[str, np.ndarray], options: dict[str, Any], progress: Progress
    ) -> dict[str, np.ndarray] | None:
        """Send a request; return the answer's arrays, {} if the tool fails, None if Blender crashes or times out."""
        progress(0.0, tool)
        self._asked += 1
        base = Path(self._folder.name) / str(self._asked)
        file, answer = base.with_suffix(".npz"), base.with_suffix(".answer.npz")
        np.savez(file, **arrays)  # type: ignore[arg-type]
        limit = TIMEOUT
        if self._process is None:
            self._process, limit = start_blender(Path(self._folder.name), SCRIPT), TIMEOUT + START_TIMEOUT
        wanted = {"tool": tool, "options": options, "given": str(file), "answer": str(answer)}
        ends = time.monotonic() + limit
        try:
            assert self._process.stdin is not None
            self._process.stdin.write(json.dumps(wanted) + "\n")
            self._process.stdin.flush()
            while not answer.exists():
                if self._process.poll() is not None or time.monotonic() > ends:
                    self._end()
                    return None
                time.sleep(POLL_INTERVAL)
                progress(0.0, tool)
        except OSError:  # the process ended before the request arrived
            self._end()
            return None
        except BaseException:  # such as a cancel: end the tool that is still running
            self._end()
            raise
        with np.load(answer) as answers:
            return dict(answers)

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process = None


def start_blender(
    folder: Path, script: Path, arguments: Sequence[str] = (), output: IO[bytes] | int = subprocess.DEVNULL
) -> subprocess.Popen[str]:
    """Start a Blender that runs a script and reads requests from standard input.

    It gets empty user folders of its own: in the user's folders it would delete the Python packages of all extensions,
    because it enables none of them.

    Parameters
    ----------
    folder : folder for its user files
    script : the script
    arguments : command-line arguments of the script
    output : file for its output, or a constant of ``subprocess``

    Raises
    ------
    FlexMapsError : Blender cannot be started
    """
    import bpy

    program = bpy.app.binary_path  # "" if Blender runs as the Python module bpy
    options = ["--background", "--factory-startup", "--python", str(script), "--"] if program else ["-P", str(script)]
    own = {f"BLENDER_USER_{name}": str(folder / name) for name in USER_FILES}
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # no console window on Windows
    try:
        return subprocess.Popen(
            [program or sys.executable, *options, *arguments],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT if output != subprocess.DEVNULL else output,
            text=True,
            env=os.environ | own,
            creationflags=hidden,
        )
    except OSError as error:
        raise FlexMapsError(f"Blender cannot be started a second time, which this needs: {error}") from None
