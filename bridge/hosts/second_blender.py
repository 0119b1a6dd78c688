"""A second Blender without a window for tools that the first one must not run: QuadriFlow and the voxel remesh.

QuadriFlow blocks the Blender that it runs in; after one ESC it believes itself cancelled for the rest of the session; and on
some surfaces it never returns. A separate process can be watched and ended.
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
from .background import TICK

SCRIPT = Path(__file__).with_name("second_blender_script.py")
# seconds until a request is given up: the slowest of 60 QuadriFlow runs on 500 to 70,000 faces took 3 s of processor time
LIMIT = 30.0
START = 120.0  # further seconds if Blender has to start, which takes some 4 s; generous for slow machines
# folders that Blender takes from the environment
USER_FILES = ("RESOURCES", "CONFIG", "SCRIPTS", "EXTENSIONS", "DATAFILES")


class SecondBlender:
    """The tools of ``engine.surface.remeshing.requad``; use it in a ``with``, so that its process ends.

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

    def touching(self, parts: list[PolygonMesh], progress: Progress = SILENT) -> list[tuple[int, int]]:
        first = np.cumsum([0, *(len(part.vertices) for part in parts)])
        arrays = {
            "vertices": np.concatenate([part.vertices for part in parts]),
            "corners": np.concatenate([part.corners + k for part, k in zip(parts, first, strict=False)]),
            "body": np.repeat(np.arange(len(parts)), [len(part.sizes) for part in parts]),
        }
        answered = self._ask("touching", arrays, {}, progress)
        return [] if answered is None else [(int(a), int(b)) for a, b in answered["pairs"]]

    # -- the process -----------------------------------------------------------------------------------------------------

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
        """Send a request and return the answer's arrays; {} where Blender refuses, None where it crashed or timed out."""
        progress(0.0, tool)
        self._asked += 1
        base = Path(self._folder.name) / str(self._asked)
        file, answer = base.with_suffix(".npz"), base.with_suffix(".answer.npz")
        np.savez(file, **arrays)  # type: ignore[arg-type]
        limit = LIMIT
        if self._process is None:
            self._process, limit = started(Path(self._folder.name), SCRIPT), LIMIT + START
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
                time.sleep(TICK)
                progress(0.0, tool)
        except OSError:  # the process ended before the request arrived
            self._end()
            return None
        except BaseException:  # cancelled
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


def started(
    folder: Path, script: Path, words: Sequence[str] = (), out: IO[bytes] | int = subprocess.DEVNULL
) -> subprocess.Popen[str]:
    """Start a Blender that runs a script and listens on standard input, with its own user files in a folder.

    With the user's files it would delete the Python packages of all extensions, because none is enabled in it.

    Parameters
    ----------
    folder : for its user files
    script : the script
    words : arguments of the script
    out : where its output goes

    Raises
    ------
    FlexMapsError where Blender cannot be started.
    """
    import bpy

    program = bpy.app.binary_path  # "" where Blender is a module of Python
    options = ["--background", "--factory-startup", "--python", str(script), "--"] if program else ["-P", str(script)]
    own = {f"BLENDER_USER_{name}": str(folder / name) for name in USER_FILES}
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # no console window on Windows
    try:
        return subprocess.Popen(
            [program or sys.executable, *options, *words],
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=subprocess.STDOUT if out != subprocess.DEVNULL else out,
            text=True,
            env=os.environ | own,
            creationflags=hidden,
        )
    except OSError as error:
        raise FlexMapsError(f"Blender cannot be started a second time, which this needs: {error}") from None
