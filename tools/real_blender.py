"""A real Blender with its window, for tests: Debian's, in a folder of its own, on a virtual screen.

The folder is made once (about a minute, 1.4 GB) in ~/.cache/flexmaps or where FLEXMAPS_BLENDER_ROOT points, and entered by
chroot in a mount namespace of its own, so that nothing stays mounted. That needs root on a Debian-like Linux.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGES = (
    "blender,python3-numpy,python3-requests,python3-zstandard,xvfb,xauth,xdotool,x11-utils,openbox,"
    "libgl1-mesa-dri,libegl1,libgl1,mesa-utils"
)
SUITE = "trixie"
SCREEN = (1100, 900)  # pixels: the sidebar without scrolling beside a view that shows a piece

ENTER = """
set -e
root={root} work={work}
mount --rbind /sys $root/sys
mount --rbind /dev $root/dev
mount -t proc proc $root/proc
mkdir -p $root$work
mount --bind $work $root$work
exec chroot $root /usr/bin/env -i /bin/bash $work/inside.sh
"""

HEAD = """
export HOME=/root PATH=/usr/bin:/bin:/usr/sbin LIBGL_ALWAYS_SOFTWARE=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1
export BLENDER_USER_RESOURCES={work}/user
cd {work}
"""

INSIDE = """
{screen}
timeout {timeout} blender {options} --python {work}/{script}
status=$?
[ -z "$(jobs -p)" ] || kill $(jobs -p)
exit $status
"""

VIRTUAL_SCREEN = """
mkdir -p /tmp/.X11-unix
Xvfb -displayfd 3 -screen 0 {width}x{height}x24 +extension GLX -nolisten tcp -fbdir {work} 3>{work}/display 2>{work}/xvfb.log &
for i in $(seq 100); do [ -s {work}/display ] && break; sleep 0.1; done
export DISPLAY=:$(cat {work}/display)
openbox >/dev/null 2>&1 &
"""


def folder() -> Path:
    """Return the folder of the Debian with its Blender."""
    return Path(os.environ.get("FLEXMAPS_BLENDER_ROOT", Path.home() / ".cache" / "flexmaps" / SUITE))


def obstacle() -> str | None:
    """Return the reason why no real Blender is available, as a sentence; ``None`` if one is. Installs it on the first call."""
    if sys.platform != "linux" or not hasattr(os, "geteuid") or os.geteuid() != 0:
        return "a real Blender for the window needs root on Linux (chroot)"
    if subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode:
        return "this machine allows no mount namespaces (unshare -m), which the real Blender runs in"
    if (folder() / "usr" / "bin" / "blender").exists():
        return None
    if shutil.which("mmdebstrap") is None:
        if shutil.which("apt-get") is None:
            return "mmdebstrap is missing, which makes the folder of the real Blender"
        for command in (["apt-get", "update", "-q"], ["apt-get", "install", "-q", "-y", "mmdebstrap"]):
            if subprocess.run(command, capture_output=True).returncode:
                return f"mmdebstrap could not be installed: '{' '.join(command)}' failed"
    print(f"Making a real Blender in {folder()} (once, about a minute)", file=sys.stderr, flush=True)
    folder().parent.mkdir(parents=True, exist_ok=True)
    # a folder of one's own, for somebody else may be making it too
    making = Path(tempfile.mkdtemp(prefix=f"{folder().name}-making-", dir=folder().parent))
    making.chmod(0o755)  # for apt's own user
    command = ["mmdebstrap", "--variant=minbase", f"--include={PACKAGES}", SUITE, str(making)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode == 0 and not folder().exists():
        making.rename(folder())
        return None
    shutil.rmtree(making, ignore_errors=True)
    if done.returncode == 0:
        return None
    lines = [line for line in done.stderr.splitlines() if line.startswith("E: ")] or done.stderr.splitlines()
    return f"mmdebstrap failed: {lines[0] if lines else 'no reason given'}"


def run(
    script: Path, work: Path, *, window: bool, timeout: int = 240, variables: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run a Python script in the real Blender; ``work`` is the one folder that both sides see, by the same path.

    The script's neighbours come with it, for it to import. With ``window``, Blender has a window on a virtual screen whose pixels
    are in ``work``/Xvfb_screen0. ``variables`` of the environment are written as a shell does: "NAME=value OTHER=value".
    """
    for file in script.parent.glob("*.py"):
        shutil.copy2(file, work)
    width, height = SCREEN
    place = shlex.quote(str(work))
    screen = VIRTUAL_SCREEN.format(work=place, width=width, height=height) if window else ""
    options = "--factory-startup --window-fullscreen" if window else "--factory-startup -b"
    text = INSIDE.format(work=place, screen=screen, timeout=timeout, options=options, script=script.name)
    return shell(f"export {variables}\n{text}" if variables else text, work, timeout)


def shell(text: str, work: Path, timeout: int = 240) -> subprocess.CompletedProcess[str]:
    """Run lines of a shell where ``blender`` is the real one, in the folder ``work``, which both sides see by the same path."""
    place = shlex.quote(str(work))
    (work / "inside.sh").write_text(HEAD.format(work=place) + text)
    enter = ENTER.format(root=shlex.quote(str(folder())), work=place)
    return subprocess.run(["unshare", "-m", "bash", "-c", enter], capture_output=True, text=True, timeout=timeout + 60)


def picture(pixels: Path, target: Path) -> None:
    """Xvfb's frame buffer (an xwd file) as a PNG."""
    import struct

    import numpy as np
    from PIL import Image

    data = pixels.read_bytes()
    header = struct.unpack(">25I", data[:100])
    width, height, stride, colours = header[4], header[5], header[12], header[19]
    start = header[0] + 12 * colours
    rows = np.frombuffer(data[start : start + stride * height], np.uint8).reshape(height, stride // 4, 4)
    Image.fromarray(np.ascontiguousarray(rows[:, :width, 2::-1])).save(target)
