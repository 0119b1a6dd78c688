"""Builds engine/runs/page/three.min.js: the parts of three.js that the page's 3D view needs, in one file with its licence.

    python3 tools/dev.py python tools/page_library.py

Only who wants another version needs this, and with it Node.js with npm: change the version in tools/page_library/package.json
first, then look at the page (``test page``). The file is committed, so that nothing else ever asks for npm.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent / "page_library"
TARGET = HERE.parents[1] / "engine" / "runs" / "page"
# browsers that inflate data by themselves, which the page needs too, know all of it
SYNTAX = "es2022"


def main() -> int:
    """Install in a folder of its own, bundle, and put library and licence beside the page's scripts."""
    if shutil.which("npm") is None:
        print("npm is missing: install Node.js", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for path in HERE.iterdir():
            if path.is_file():
                shutil.copy2(path, work)
        install = "ci" if (work / "package-lock.json").is_file() else "install"
        subprocess.run(["npm", install, "--no-audit", "--no-fund", "--silent"], cwd=work, check=True)
        three = work / "node_modules" / "three"
        version = json.loads((three / "package.json").read_text(encoding="utf-8"))["version"]
        licence = (three / "LICENSE").read_text(encoding="utf-8").strip()
        banner = f"/*! three.js {version}, https://threejs.org, a part of it, bundled and minified by esbuild\n\n{licence}\n*/"
        esbuild = work / "node_modules" / ".bin" / "esbuild"
        made = work / "three.min.js"
        options = ["--bundle", "--minify", "--format=iife", "--global-name=THREE", "--legal-comments=none"]
        subprocess.run(
            [esbuild, "library.js", *options, f"--target={SYNTAX}", f"--banner:js={banner}", f"--outfile={made}"],
            cwd=work,
            check=True,
        )
        shutil.copyfile(made, TARGET / "three.min.js")
        (TARGET / "three.LICENSE.txt").write_text(f"three.js {version}\n\n{licence}\n", encoding="utf-8")
        shutil.copyfile(work / "package-lock.json", HERE / "package-lock.json")
    print(f"three.js {version}: {(TARGET / 'three.min.js').stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
