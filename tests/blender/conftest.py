"""Every test here begins with an empty file and the extension enabled."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import flexmaps
import numpy as np
import pytest
from flexmaps.engine.extras.choosing import prospects
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import QuadMesh

sys.path.append(str(Path(__file__).parent))  # for what several tests share, in support/
sys.modules["flexmaps_shapes"].watch("bridge/store", "bridge/view")

_trying: list[bool] = []


@pytest.fixture(scope="module", autouse=True)
def small_shapes() -> Iterator[None]:
    """Make the dome and the strip of fewer quads: several panels are enough here. Tests of other tiers keep the usual ones."""
    few = {"dome": partial(shapes.dome, 6), "strip": partial(shapes.strip, 18)}
    with pytest.MonkeyPatch.context() as patch:
        for name, builder in few.items():
            patch.setitem(shapes.BUILDERS, name, builder)
        yield


@pytest.fixture(scope="module", autouse=True)
def optimise_without_prospects() -> Iterator[None]:
    """Let the button Optimise find nothing that brings a piece nearer, unless a test uses ``tried_prospects``.

    Trying other cuts and supports takes about as long as the search for the spirals itself. It holds for the modules of this tier
    alone: tests of the function itself may run in the same process.
    """
    original = prospects.find_prospects

    def found(*args: Any, **named: Any) -> dict[str, float] | None:
        return original(*args, **named) if _trying else {}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(prospects, "find_prospects", found)
        yield


@pytest.fixture
def tried_prospects() -> Iterator[None]:
    """Let Optimise try what brings a piece nearer, as it does for users."""
    _trying.append(True)
    yield
    _trying.pop()


@pytest.fixture(scope="session")
def extension(merge_without_prediction: None, quick_nesting: None) -> Iterator[None]:
    flexmaps.register()
    yield
    flexmaps.unregister()


@pytest.fixture(autouse=True)
def empty(extension: None) -> None:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    manager = bpy.context.window_manager
    manager.flexmaps_overlay, manager.flexmaps_chosen = "NONE", False


Add = Callable[..., Any]


@pytest.fixture
def add() -> Add:
    """Put a quad mesh, or vertices and faces, into the scene as the active object."""

    def make(mesh: QuadMesh | tuple[Any, Any], name: str = "piece") -> Any:
        vertices, faces = (mesh.vertices, mesh.quads) if isinstance(mesh, QuadMesh) else mesh
        data = bpy.data.meshes.new(name)
        data.from_pydata(np.asarray(vertices).tolist(), [], [list(map(int, face)) for face in faces])
        obj = bpy.data.objects.new(name, data)
        bpy.context.scene.collection.objects.link(obj)
        bpy.context.view_layer.objects.active = obj
        obj.select_set(True)
        bpy.context.view_layer.update()
        return obj

    return make


@pytest.fixture
def dome(add: Add) -> Any:
    """A small open surface with real curvature, quads of 20 mm."""
    return add(shapes.make("dome"))


Once = Callable[[str, Callable[[], Any]], Any]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Pieces that take seconds to make: the file as a function leaves it is kept by a name, and read back in every test.

    Also in the first, so that all begin alike. The file has no path, as if it had never been saved; the active object is returned.
    """
    folder = tmp_path_factory.mktemp("once")

    def read(name: str, make: Callable[[], Any]) -> Any:
        path = folder / f"{name}.blend"
        if not path.is_file():
            bpy.ops.wm.read_homefile(
                use_factory_startup=True, use_empty=True
            )  # what other fixtures made would take its names
            make()
            bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, check_existing=False)
        bpy.ops.wm.read_homefile(filepath=str(path), load_ui=False)
        bpy.context.view_layer.update()
        return bpy.context.view_layer.objects.active

    return read


def _spiralled(add: Add) -> Any:
    mesh = shapes.dome(8)  # is made once, and its panels keep their points in every stroke of a brush
    dome = add(mesh.with_vertices(mesh.vertices * (0.02 / mesh.median_edge)))
    dome.flexmaps.connect.connector = "none"
    dome.flexmaps.sheet.nesting = "FAST"
    for stage in ("trace", "spirals"):
        assert getattr(bpy.ops.flexmaps, stage)() == {"FINISHED"}
    return dome


@pytest.fixture
def spiralled(add: Add, once: Once) -> Any:
    """The same in several panels, with their spirals but without connectors and closely nested sheets, which is quicker."""
    return once("spiralled", lambda: _spiralled(add))


@pytest.fixture
def simulated(add: Add, once: Once) -> Any:
    """The same, simulated."""

    def make() -> None:
        _spiralled(add)
        assert bpy.ops.flexmaps.simulate() == {"FINISHED"}

    return once("simulated", make)


def _content(obj: Any) -> dict[str, bytes]:
    """Everything that a mesh holds but the selection, as bytes, edit mode included."""
    obj.update_from_editmode()
    mesh = obj.data.copy()
    found: dict[str, bytes] = {"report": str(mesh.get("flexmaps_report")).encode()}
    kinds = {"FLOAT": ("value", "f", 1), "INT": ("value", "i", 1), "BOOLEAN": ("value", "?", 1), "FLOAT2": ("vector", "f", 2),
             "FLOAT_VECTOR": ("vector", "f", 3), "FLOAT_COLOR": ("color", "f", 4), "INT32_2D": ("value", "i", 2)}  # fmt: skip
    for attribute in mesh.attributes:
        if attribute.name.startswith((".select", ".vs.", ".es.", ".pn.", ".hide")):
            continue
        prop, dtype, width = kinds[attribute.data_type]
        values = np.empty(len(attribute.data) * width, dtype=dtype)
        attribute.data.foreach_get(prop, values)
        found[attribute.name] = values.tobytes()
    seams = np.empty(len(mesh.edges), bool)
    mesh.edges.foreach_get("use_seam", seams)
    found["seams"] = seams.tobytes()
    bpy.data.meshes.remove(mesh)
    return found


def _seams_of(obj: Any) -> np.ndarray:
    obj.update_from_editmode()
    found = np.empty(len(obj.data.edges), bool)
    obj.data.edges.foreach_get("use_seam", found)
    return found


def _attribute(obj: Any, name: str, prop: str = "value", width: int = 1) -> np.ndarray:
    data = obj.data.attributes[name].data
    values = np.empty(len(data) * width, np.float32)
    data.foreach_get(prop, values)
    return values.reshape(-1, width) if width > 1 else values


@pytest.fixture
def content() -> Callable[[Any], dict[str, bytes]]:
    return _content


@pytest.fixture
def seams_of() -> Callable[[Any], np.ndarray]:
    return _seams_of


@pytest.fixture
def attribute() -> Callable[..., np.ndarray]:
    return _attribute


@pytest.fixture
def all_of(content: Callable[[Any], dict[str, bytes]]) -> Callable[[Any], dict[str, bytes]]:
    """What the mesh holds, shape keys included."""

    def found(obj: Any) -> dict[str, bytes]:
        keys = obj.data.shape_keys
        blocks = () if keys is None else keys.key_blocks
        return content(obj) | {f"key {b.name}": np.array([p.co[:] for p in b.data]).tobytes() for b in blocks}

    return found
