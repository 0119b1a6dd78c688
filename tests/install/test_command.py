"""``blender --command flexmaps`` in a real Blender, from the installed zip."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = pytest.mark.timeout(900)  # Blender starts many times, maybe on a busy machine
LINES = """
say() {{ "$@" > $name.out 2> $name.err; echo $? > $name.status; }}
name=install; say blender --command extension install-file -r user_default -e {zip}
name=help; say blender --command flexmaps --help
name=simulate; say blender --command flexmaps simulate shape:strip --supports lowest --json --out strip.blend
name=report; say blender --command flexmaps report strip.blend --out report
name=export; say blender --command flexmaps export strip.blend --set sheet.nesting=FAST --formats svg --out sheets
name=mistake; say blender --command flexmaps simulate nowhere.obj
cat > script.py <<'END'
from bl_ext.user_default.flexmaps import api
print("quads:", len(api.load("shape:strip").mesh.quads))
END
name=script; say blender -b --python script.py
blender --command flexmaps run shape:dome --edge 10 --optimise --out stopped > stopped.out 2> stopped.err &
for i in $(seq 200); do grep -q Step stopped.err && break; sleep 0.5; done
kill -INT $!; wait $!; echo $? > stopped.status
"""


def test_command_and_api_of_the_installed_extension(real_blender: ModuleType, debian_zip: Path, tmp_path: Path) -> None:
    zip_file = Path(shutil.copy2(debian_zip, tmp_path))
    done = real_blender.shell(LINES.format(zip=zip_file.name), tmp_path, timeout=800)

    def said(name: str, kind: str) -> str:
        path = tmp_path / f"{name}.{kind}"
        assert path.is_file(), done.stdout + done.stderr
        return path.read_text()

    statuses = {path.stem: int(path.read_text()) for path in tmp_path.glob("*.status")}
    assert statuses == {
        "install": 0, "help": 0, "simulate": 0, "report": 0, "export": 0, "mistake": 2, "script": 0, "stopped": 130,
    }, said("install", "err") + said("simulate", "err")  # fmt: skip
    assert "optimise" in said("help", "out")
    report = json.loads(said("simulate", "out"))
    assert report["equilibrium"]["converged"] and "100%" in said("simulate", "err")
    assert (tmp_path / "report" / "report.html").is_file()
    assert (tmp_path / "report" / "share.html").is_file()  # what it is made of came with the zip
    assert (tmp_path / "sheets" / "sheet-01.svg").is_file()
    assert said("mistake", "out") == ""
    assert said("mistake", "err").count("flexmaps: ") == 1 and "Traceback" not in said("mistake", "err")
    assert "quads: 108" in said("script", "out")
    assert not (tmp_path / "stopped").exists()
