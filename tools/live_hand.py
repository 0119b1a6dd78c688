"""Random editing of a piece in live mode, with checks that the displayed shape belongs to the present piece."""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import flexmaps
import numpy as np
from flexmaps.bridge.hosts import background, live
from flexmaps.bridge.store import attributes, live_input
from flexmaps.engine.surface import shapes

PATIENCE = 60.0  # seconds of the clock after which a shape that does not come counts as lost
SAME = 0.05  # millimetres between two shapes of the same state


class Hand:
    """Everything that it does is one step of undo; ``seen`` are the shapes that belong to states that were there."""

    def __init__(self, folder: Path, seed: int = 0):
        self.folder, self.rng = folder, np.random.default_rng(seed)
        self.done: Counter[str] = Counter()
        self.errors: list[str] = []
        self.lost = 0
        self.slowest = 0.0
        self.seen: dict[bytes, np.ndarray] = {}
        if not hasattr(bpy.types.Object, "flexmaps"):
            flexmaps.register()
        self.obj = self._piece()
        bpy.ops.flexmaps.live()
        self.uid = self.obj.session_uid
        self._settle()

    def _piece(self) -> Any:
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        mesh = shapes.make("dome")
        data = bpy.data.meshes.new("piece")
        data.from_pydata(mesh.vertices.tolist(), [], mesh.quads.tolist())
        obj = bpy.data.objects.new("piece", data)
        bpy.context.scene.collection.objects.link(obj)
        bpy.context.view_layer.objects.active = obj
        obj.select_set(True)
        obj.flexmaps.connect.connector = "none"
        bpy.ops.flexmaps.trace()
        bpy.ops.flexmaps.spirals()
        group = obj.vertex_groups.new(name="feet")
        low = mesh.vertices[:, 2] < mesh.vertices[:, 2].min() + 1e-3
        group.add(np.flatnonzero(low).tolist(), 1.0, "REPLACE")
        obj.flexmaps.loads.supports = "feet"
        bpy.ops.ed.undo_push(message="begin")
        return obj

    @property
    def process(self) -> int:
        """Return the process beside Blender."""
        process = live.current_watcher()._process  # type: ignore[union-attr]
        return next(iter(process._workers._all))._popen.pid  # type: ignore[union-attr]

    def close(self) -> None:
        live.stop()

    def act(self) -> None:
        """Perform one random action and check its result."""
        name = str(self.rng.choice([*ACTS], p=np.array([*WEIGHTS]) / sum(WEIGHTS)))
        try:
            ACTS[name](self)
            self.done[name] += 1
            self.obj = next(o for o in bpy.data.objects if o.session_uid == self.uid)
            if self.rng.random() < 0.2:  # a hand does not wait
                live.current_watcher().tick()  # type: ignore[union-attr]
            else:
                self._settle()
        except Exception:
            self.errors.append(f"{name}: {traceback.format_exc()}")

    def _settle(self) -> None:
        """Tick as the window does, until the piece rests; what is shown then is compared with what was shown of the same state."""
        following = live.current_watcher()
        assert following is not None
        following.is_dirty = True
        following._next_read = 0.0
        end = time.monotonic() + PATIENCE
        while True:
            following.tick()
            if following.shape is not None and following.is_resting and not following.is_dirty:
                break
            if time.monotonic() > end:
                self.lost += 1
                return
            time.sleep(background.POLL_INTERVAL)
        self.slowest = max(self.slowest, following.slowest_tick)
        now = live_input.read(self.obj, bpy.context.scene)
        if following._process.error or following._input is None or now.changes(following._input):  # type: ignore[union-attr]
            self.lost += 1
            return
        shape = following.shape
        if following.problem or not shape.converged:
            return  # live mode reports the problem and keeps the last good shape
        before = self.seen.get(now.mark)
        assert shape.vertices is not None
        if before is not None and 1e3 * float(np.abs(before - shape.vertices).max()) > SAME:
            self.lost += 1
        self.seen = {**dict(list(self.seen.items())[-20:]), now.mark: shape.vertices}

    # -- what it does ------------------------------------------------------------------------------------------------------

    def stroke(self) -> None:
        with attributes.readable_mesh(self.obj) as copy:
            width, twist = (np.array(attributes.read(copy, f"flexmaps_{n}")) for n in ("width", "twist"))
            middles = np.array([p.center for p in copy.polygons])
        near = np.argsort(np.linalg.norm(middles - middles[self.rng.integers(len(middles))], axis=1))[
            : max(1, len(middles) // 20)
        ]
        factor = self.rng.choice([0.85, 1.15])
        width.reshape(-1, 4)[near] = np.clip(width.reshape(-1, 4)[near] * factor, 0.8, 2.0)
        twist[near] = np.clip(twist[near] / factor, 0.0, 360.0)
        attributes.write(self.obj, "flexmaps_width", "CORNER", "FLOAT", width)
        attributes.write(self.obj, "flexmaps_twist", "FACE", "FLOAT", twist)
        bpy.ops.ed.undo_push(message="stroke")

    def setting(self) -> None:
        own = self.obj.flexmaps
        which = self.rng.integers(3)
        if which == 0:
            own.spiral.thickness = float(self.rng.choice([1.5, 2.0, 2.5]))
        elif which == 1:
            own.material.material = str(self.rng.choice(["pom", "pla", "petg"]))
        else:
            own.simulate.gravity = not own.simulate.gravity
        bpy.ops.ed.undo_push(message="setting")

    def support(self) -> None:
        if self.obj.mode == "EDIT":
            bpy.ops.object.mode_set(mode="OBJECT")
        some = self.rng.choice(len(self.obj.data.vertices), 4, replace=False).tolist()
        self.obj.vertex_groups["feet"].add(some, 1.0, "REPLACE")
        bpy.ops.ed.undo_push(message="support")

    def seam(self) -> None:
        seams = np.zeros(len(self.obj.data.edges), bool)
        with attributes.readable_mesh(self.obj) as copy:
            copy.edges.foreach_get("use_seam", seams)
        one = self.rng.integers(len(seams))
        seams[one] = ~seams[one]
        attributes.write_seams(self.obj, seams)
        bpy.ops.ed.undo_push(message="seam")

    def pull(self) -> None:
        with attributes.readable_mesh(self.obj) as copy:
            at = np.array([v.co for v in copy.vertices])
        away = np.linalg.norm(at - at[self.rng.integers(len(at))], axis=1)
        at = at + 0.001 * self.rng.normal(size=3) * np.exp(-((away / 0.04) ** 2))[:, None]
        attributes.write_positions(self.obj, at)
        bpy.ops.ed.undo_push(message="pull")

    def mode(self) -> None:
        bpy.ops.object.mode_set(mode=str(self.rng.choice(["OBJECT", "EDIT", "WEIGHT_PAINT", "VERTEX_PAINT"])))

    def undo(self) -> None:
        if bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()

    def redo(self) -> None:
        if bpy.ops.ed.redo.poll():
            bpy.ops.ed.redo()

    def save(self) -> None:
        bpy.ops.wm.save_as_mainfile(filepath=str(self.folder / "piece.blend"), copy=True)


ACTS: dict[str, Callable[[Hand], None]] = {
    "strokes": Hand.stroke,
    "settings": Hand.setting,
    "supports": Hand.support,
    "seams": Hand.seam,
    "pulls": Hand.pull,
    "modes": Hand.mode,
    "undone": Hand.undo,
    "redone": Hand.redo,
    "saved": Hand.save,
}
# how often each of them: mostly strokes, and half as many steps back, so that most of what was done is seen twice; by eye
WEIGHTS = (8, 2, 1, 1, 1, 2, 4, 2, 1)
