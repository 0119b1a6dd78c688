"""A fresh Blender: the environment's module without any other packages, and with new user files.

For the tests of the zip, for ``release``, which installs what it has built, and for ``bench install``.
"""

from __future__ import annotations

import functools
import http.server
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# what Blender itself brings: the module, its numpy, and what its own scripts import
BLENDERS_OWN = (
    "bpy",
    "numpy",
    "numpy.libs",
    "requests",
    "certifi",
    "charset_normalizer",
    "idna",
    "urllib3",
    "zstandard",
    "attr",
    "attrs",
    "cattr",
    "cattrs",
    "Cython",
)

# installs a zip, or enables what is installed ("enable"), or makes a piece with it too ("use")
SCRIPT = """
import importlib, json, os, sys, time
import bpy

zip_file = sys.argv[-1]
if zip_file.endswith(".zip"):
    clock = time.perf_counter()
    bpy.ops.extensions.package_install_files(filepath=zip_file, repo="user_default", enable_on_install=False)
    told = {"install_s": time.perf_counter() - clock}
else:
    clock, work = time.perf_counter(), time.process_time()
    bpy.ops.preferences.addon_enable(module="bl_ext.user_default.flexmaps")
    told = {"enable_s": time.perf_counter() - clock, "enable_cpu_s": time.process_time() - work}
if zip_file == "use":
    api = importlib.import_module("bl_ext.user_default.flexmaps.api")
    piece = api.simulate(api.load("shape:strip", edge=20))
    told["spirals"] = len(piece.result.design.width)
    told["version"] = importlib.import_module("bl_ext.user_default.flexmaps.engine").VERSION
print("TOLD " + json.dumps(told), flush=True)
os._exit(0)
"""


# adds a repository, installs from it and goes to the first stage, as somebody who has just dragged it into Blender
FROM_REPOSITORY = """
import json, os, sys, time
import bpy

clock = time.perf_counter()
preferences = bpy.context.preferences
preferences.system.use_online_access = True
repo = preferences.extensions.repos.new(name="FlexMaps", module="flexmaps_shop", remote_url=sys.argv[-1])
index = list(preferences.extensions.repos).index(repo)
bpy.ops.extensions.repo_sync(repo_index=index)
bpy.ops.extensions.package_install(repo_index=index, pkg_id="flexmaps", enable_on_install=True)
told = {"installed_s": time.perf_counter() - clock}
bpy.ops.flexmaps.example()
bpy.ops.flexmaps.trace()
told |= {"button_s": time.perf_counter() - clock, "button_cpu_s": sum(os.times()[:4])}
print("TOLD " + json.dumps(told), flush=True)
os._exit(0)
"""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def serve_folder(folder: Path) -> Iterator[str]:
    """Serve a folder on a local web server; yield its address."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def environment(folder: Path, python: str = sys.executable) -> dict[str, str]:
    """The environment of such a Blender, whose files go into a folder; start the Python with ``-S``."""
    site = folder / "site"
    site.mkdir()
    asked = [python, "-c", "import numpy; print(numpy.__file__)"]
    here = (
        Path(subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()).resolve().parent.parent
    )
    for name in BLENDERS_OWN:
        if (here / name).exists():
            (site / name).symlink_to(here / name)
    found = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return found | {"BLENDER_USER_RESOURCES": str(folder / "user"), "PYTHONPATH": str(site)}


def try_zip(zip_file: Path, folder: Path, python: str = sys.executable) -> dict[str, Any]:
    """Install a zip into such a Blender, start it anew and make a piece there; returns what ``SCRIPT`` tells.

    Raises ``RuntimeError`` with Blender's last words where that fails.
    """
    own, found = environment(folder, python), dict[str, Any]()
    for word in (str(zip_file), "use"):
        found |= run_script(SCRIPT, word, folder, own, python)
    return found


def run_script(
    script: str, word: str, folder: Path, own: dict[str, str], python: str = sys.executable
) -> dict[str, Any]:
    """Run a script in such a Blender and return its result; raises ``RuntimeError`` with the end of Blender's output if it fails."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    command = [python, "-S", str(folder / "script.py"), word]
    done = subprocess.run(command, env=own, cwd=folder, capture_output=True, text=True, timeout=280)
    lines = [line for line in done.stdout.splitlines() if line.startswith("TOLD ")]
    if not lines:
        raise RuntimeError(f"{word}: it does not work: {(done.stdout + done.stderr)[-2000:]}")
    made: dict[str, Any] = json.loads(lines[0].removeprefix("TOLD "))
    return made
