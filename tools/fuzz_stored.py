"""Fuzzing of the data that an object in Blender stores of its stages, each case generated from its number; then stages run on it."""

from __future__ import annotations

import contextlib
import io
import json
import random
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import flexmaps
import numpy as np
from flexmaps import api
from flexmaps.bridge.store import attributes, stored_report
from flexmaps.engine.errors import FlexMapsError
from random_calls import undrawn

WRONG: tuple[Any, ...] = (
    "", "{}", "[]", "null", "5", "{", "[" * 100_000, '{"a":' * 5_000, '{"checks": 5}', '{"layout": []}', '{"spirals": {}}',
    '{"equilibrium": {"converged": true}}', "\ud7ff", b"\xff\xfe", 5, -1, 2.5, float("nan"), [1, 2, 3], [1.5], {"a": {"b": 1}}, True,
)  # fmt: skip
# what an attribute may hold after damage
VALUES = (np.nan, np.inf, -np.inf, 1e30, -1e30, -1.0, 0.0, 1e-30, 1e5, 2**31 - 1, -(2**31))
DOMAINS = ("POINT", "EDGE", "FACE", "CORNER")
# quick: what is tried is whether damage is noticed, not how good a result is
SETTINGS = {"simulate.iterations": 20, "optimise.iterations": 2, "optimise.codesign": False, "sheet.nesting": "FAST"}


@cache
def _template() -> Path:
    """A .blend file with a small piece that has been through all stages."""
    if not hasattr(bpy.types.Object, "flexmaps"):
        flexmaps.register()
    path = Path(tempfile.mkdtemp(prefix="flexmaps-fuzz-")) / "piece.blend"
    piece = api.load("shape:dome", edge=20, settings=SETTINGS | {"connect.connector": "none"})
    api.save(api.sheets(api.optimise(piece, supports="lowest")), path)
    return path


# -- damage ------------------------------------------------------------------------------------------------------------


def _text(rng: random.Random, mesh: Any) -> str:
    """Another text, or something else, in the place of a note."""
    name = rng.choice(
        (
            stored_report.NAME,
            stored_report.NAME,
            stored_report.INPUT_CHECKSUMS,
            stored_report.NAME + stored_report.CHECKSUM_SUFFIX,
            stored_report.INPUT_CHECKSUMS + stored_report.CHECKSUM_SUFFIX,
            stored_report.UNSTAMPED,
        )
    )
    old = mesh.get(name)
    if isinstance(old, str) and old and rng.random() < 0.5:
        start = rng.randrange(len(old))
        new: Any = (
            old[:start] + rng.choice(("", "9", "-", "null", '"', "}", "NaN", old)) + old[start + rng.randrange(20) :]
        )
        if rng.random() < 0.3:
            new = _other_value(rng, old)
    else:
        new = rng.choice(WRONG)
    if rng.random() < 0.1:
        if name in mesh:
            del mesh[name]
        return f"del {name}"
    mesh[name] = new
    return f"{name} = {str(new)[:40]!r}"


def _other_value(rng: random.Random, text: str) -> str:
    """Return the JSON with one value changed."""
    try:
        found = json.loads(text)
    except ValueError:
        return text
    here: Any = found
    while isinstance(here, dict | list) and here:
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))
        key = rng.choice(keys)
        if not isinstance(here[key], dict | list) or not here[key] or rng.random() < 0.3:
            here[key] = rng.choice((None, "x", -1, 1e308, [], {}, True, [[1]], float("nan")))
            break
        here = here[key]
    return json.dumps(found)


def _attribute(rng: random.Random, mesh: Any) -> str:
    """An attribute of ours gone, elsewhere, of another kind, or with other values."""
    name = attributes.PREFIX + rng.choice(list(attributes.SPECS))
    found = mesh.attributes.get(name)
    what = rng.choice(("remove", "kind", "values", "values", "values", "all"))
    if found is None or what == "kind":
        if found is not None:
            mesh.attributes.remove(found)
        kind, domain = (
            rng.choice([*attributes.KINDS, "INT8", "STRING", "BYTE_COLOR", "QUATERNION"]),
            rng.choice(DOMAINS),
        )
        mesh.attributes.new(name, kind, domain)
        return f"{name} {kind} {domain}"
    if what == "remove" or found.data_type not in attributes.KINDS:  # another mutation has given it such a kind
        mesh.attributes.remove(found)
        return f"del {name}"
    prop, width, dtype, _ = attributes.KINDS[found.data_type]
    values: np.ndarray = np.empty(len(found.data) * width, dtype)
    found.data.foreach_get(prop, values)
    value = rng.choice(VALUES)
    if not np.issubdtype(dtype, np.floating):
        value = rng.choice((0, 1, -1, 7, 2**31 - 1, -(2**31)))
    at = slice(None) if what == "all" else rng.sample(range(len(values)), min(len(values), rng.choice((1, 2, 5))))
    values[at] = value
    found.data.foreach_set(prop, values)
    return f"{name}[{at}] = {value}"


def _property(rng: random.Random, obj: Any) -> str:
    """Custom properties by which the pieces beside the model are found."""
    owner = rng.choice([obj, *bpy.data.objects, *bpy.data.collections])
    name = rng.choice(("flexmaps_collection", "flexmaps_owner", "flexmaps_kind", "flexmaps_look"))
    value = rng.choice([*WRONG, *bpy.data.collections, *bpy.data.objects])
    owner[name] = value
    return f"{owner.name}[{name!r}] = {str(value)[:40]!r}"


def _shape(rng: random.Random, obj: Any) -> str:
    """Vertices or shape keys that are nowhere, or other faces than before."""
    mesh = obj.data
    what = rng.choice(("vertex", "key", "key", "name", "faces", "seams", "group"))
    if what == "seams":
        for edge in rng.sample(list(mesh.edges), 5):
            edge.use_seam = not edge.use_seam
    elif what == "group":
        for group in list(obj.vertex_groups):
            obj.vertex_groups.remove(group)
    elif what == "faces":
        import bmesh

        bm = bmesh.new()
        bm.from_mesh(mesh)
        bm.faces.ensure_lookup_table()
        bmesh.ops.delete(bm, geom=[rng.choice(bm.faces)], context="FACES")
        bm.to_mesh(mesh)
        bm.free()
    elif what == "vertex":
        mesh.vertices[rng.randrange(len(mesh.vertices))].co.x = rng.choice(VALUES)
    elif mesh.shape_keys is not None:
        key = rng.choice(list(mesh.shape_keys.key_blocks))
        if what == "name":
            key.name = rng.choice(("FlexMaps other shape x", "mine", "FlexMaps equilibrium"))
        else:
            key.data[rng.randrange(len(key.data))].co.z = rng.choice(VALUES)
    return what


def _setting(rng: random.Random, obj: Any) -> str:
    """Raw values in the place of settings, as a script or a newer version may leave them."""
    block = rng.choice(("spiral", "layout", "sheet", "cut", "connect", "material", "simulate", "optimise", "loads"))
    group = getattr(obj.flexmaps, block)
    names = [p.identifier for p in group.bl_rna.properties if p.identifier not in ("rna_type", "name")]
    name, value = rng.choice(names), rng.choice(("x", 5, -3, 2.5, float("nan"), [1.0, 2.0], "custom"))
    with contextlib.suppress(Exception):
        group[name] = value
    return f"{block}.{name} = {value!r}"


def _damage(rng: random.Random, obj: Any) -> list[str]:
    done = []
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        kind = rng.choice(("text", "text", "attribute", "attribute", "attribute", "property", "shape", "setting"))
        if kind in {"text", "attribute"}:
            done.append((_text if kind == "text" else _attribute)(rng, obj.data))
        else:
            done.append({"property": _property, "shape": _shape, "setting": _setting}[kind](rng, obj))
    return done


# -- calls on the damaged object -------------------------------------------------------------------------------------------


def _calls(obj: Any, folder: Path) -> dict[str, Callable[[], Any]]:
    ops = bpy.ops.flexmaps
    return {
        "check": lambda: api.check(api.load(obj)),
        "report": lambda: api.report(obj, folder),
        "simulate": lambda: api.show(api.simulate(api.load(obj))),
        "export": lambda: api.export(api.load(obj), folder),
        "save": lambda: api.save(api.load(obj), folder / "again.blend"),
        "run": lambda: api.run(obj, folder, stop_after="spirals", pictures=False, settings={"sheet.nesting": "FAST"}),
        **{
            f"button {name}": getattr(ops, name)
            for name in (
                "check",
                "merge",
                "spirals",
                "simulate",
                "report",
                "export",
                "regularise",
                "flatten",
                "preview",
            )
        },
    }


def _called(name: str, call: Callable[[], Any]) -> str:
    """Call it; ``FlexMapsError`` is not a fault."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            call()
    except FlexMapsError as error:
        assert str(error).strip()
        assert "\n" not in str(error)
        return "refused"
    except RuntimeError as error:
        text = str(error)
        if "poll()" in text or (text.strip().startswith("Error:") and "Traceback" not in text):
            return "refused"
        raise RuntimeError(text.strip().rpartition("\n")[2]) from error
    return "done"


def _begun(number: int) -> tuple[random.Random, Any, list[str]]:
    bpy.ops.wm.open_mainfile(filepath=str(_template()))
    rng = random.Random(number)
    obj = next(o for o in bpy.data.objects if "flexmaps_collection" in o)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return rng, obj, _damage(rng, obj)


def play(number: int, whole: bool) -> str:
    """Damages the piece and calls two or, ``whole``, all of the stages; the outcome of the first."""
    with tempfile.TemporaryDirectory() as folder:
        rng, obj, done = _begun(number)
        calls = _calls(obj, Path(folder))
        obj.flexmaps.export.folder = folder
        names = list(calls)
        chosen = names if whole else rng.sample(names[:6], 1) + rng.sample(names[6:], 2)
        outcomes = []
        for name in chosen:
            try:
                outcomes.append(f"{name} {_called(name, calls[name])}")
                faults = undrawn()
                assert not faults, faults[0]
            except ReferenceError:
                break  # the file was left for another one: ``run`` and ``save`` do that
            except Exception as error:
                error.add_note(f"{name} after {done}")
                raise
            if name in {"run", "save"}:
                break
        return outcomes[0]


def described(number: int) -> str:
    """Describe the damage."""
    return "; ".join(_begun(number)[2])
