"""The pictures of Blender's window in docs/guide.md and README.md: ``python3 tools/dev.py python tools/guide_pictures.py``.

Needs what the window tests need (see tools/real_blender.py). Look at the pictures before you commit them.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))
import build_zip  # noqa: E402
import real_blender  # noqa: E402

COLOURS = 255  # of a picture; enough for a user interface, and a third of the size


def main() -> int:
    reason = real_blender.obstacle()
    if reason is not None:
        print(f"No pictures: {reason}")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        shutil.copy2(build_zip.build("linux-x64", "debian-13-blender"), work)
        done = real_blender.run(ROOT / "tests" / "window" / "shots.py", work, window=True, timeout=900)
        result = work / "result.json"
        found: dict[str, Any] = (
            json.loads(result.read_text()) if result.is_file() else {"errors": [done.stdout + done.stderr]}
        )
        if found["errors"]:
            print("\n".join(found["errors"]))
            return 1
        for name, rects in found["shots"].items():
            real_blender.picture(work / f"{name}.xwd", work / f"{name}.png")
            box = rects["view"]
            if name == "presets":  # the menu only
                left, top, right, _ = rects["sidebar"]
                box = left - 40, top, right, top + 260
            picture = Image.open(work / f"{name}.png").crop(box).quantize(COLOURS, dither=Image.Dither.NONE)
            target = ROOT / "docs" / "images" / f"{name}.png"
            picture.save(target, optimize=True)
            print(f"{target.relative_to(ROOT)}  {target.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
