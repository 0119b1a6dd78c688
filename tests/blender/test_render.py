"""Pictures of target, assembled piece and panels: what they show, and that nothing is left of making them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from flexmaps.bridge.view import materials, picture, studio
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.params import RenderParams
from support.buttons import press

SMALL = {"pixels_x": 192, "samples": 1}


@pytest.fixture
def piece(simulated: Any) -> Any:
    simulated.flexmaps.render.pixels_x, simulated.flexmaps.render.samples = SMALL["pixels_x"], SMALL["samples"]
    return simulated


def pixels(path: Path) -> np.ndarray:
    """(height, width, 3) sRGB, from the top down."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    found = np.array(image.pixels).reshape(height, width, 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return found


def everything() -> dict[str, list[str]]:
    kinds = ("scenes", "objects", "meshes", "curves", "lights", "cameras", "worlds", "collections")
    return {kind: sorted(getattr(bpy.data, kind).keys()) for kind in kinds}


def test_three_things_beside_each_other(piece: Any, tmp_path: Path) -> None:
    scene = bpy.context.scene
    before, engine, camera = everything(), scene.render.engine, scene.camera
    piece.flexmaps.render.file = str(tmp_path / "all.png")
    press("render")
    assert everything() == before and (scene.render.engine, scene.camera) == (engine, camera)
    assert bpy.context.scene == scene and bpy.context.object == piece
    seen = pixels(tmp_path / "all.png")
    colourful = np.ptp(seen, axis=2) > 0.2
    border = np.concatenate([colourful[0], colourful[-1], colourful[:, 0], colourful[:, -1]])
    assert not border.any()  # nothing is cut off
    # framed tightly
    rows, columns = (np.flatnonzero(colourful.any(axis=axis)) for axis in (1, 0))
    assert np.ptp(columns) > 0.8 * seen.shape[1] and np.ptp(rows) > 0.8 * seen.shape[0]
    # target and piece stand beside each other, with the ground between them
    above = colourful[: seen.shape[0] // 4].any(axis=0)
    assert np.diff(np.flatnonzero(above)).max() > 0.05 * seen.shape[1]
    assert 0.5 < seen[2, 2].min() < 1.0  # the ground is bright, and not burnt out


def test_only_what_is_asked_for(piece: Any, tmp_path: Path) -> None:
    wide = {}
    for name in ("target", "assembled", "panels"):
        shown = {key: key == name for key in ("target", "assembled", "panels")}
        picture.render_together(piece, tmp_path / f"{name}.png", RenderParams(**SMALL, pixels_y=192, **shown))
        wide[name] = (np.ptp(pixels(tmp_path / f"{name}.png"), axis=2) > 0.12).mean()
    assert wide["target"] > 1.2 * wide["assembled"] > 0.02  # spirals have holes
    with pytest.raises(FlexMapsError, match="switch"):
        picture.render_together(piece, tmp_path / "x.png", RenderParams(target=False, assembled=False, panels=False))


@pytest.mark.parametrize("finish", ["acrylic", "SAFETY"])
def test_finishes(piece: Any, tmp_path: Path, finish: str) -> None:
    params = RenderParams(**SMALL, finish=finish, target=False, panels=False)
    picture.render_together(piece, tmp_path / "a.png", params)
    seen = pixels(tmp_path / "a.png")
    red = (seen[..., 0] - seen[..., 2]) > 0.25
    assert (red.mean() > 0.03) == (finish == "acrylic") or finish == "SAFETY"
    assert red.any()


def test_every_material_has_a_look() -> None:
    from flexmaps.engine.materials import MATERIALS

    assert set(MATERIALS) | {"custom"} == set(materials.APPEARANCES)
    for key in materials.APPEARANCES:
        made = materials.sheet_material(key)
        assert made is materials.sheet_material(key)
        assert made.node_tree.nodes["Principled BSDF"].outputs["BSDF"].is_linked


def test_the_camera_sees_all_and_no_more() -> None:
    """The nearest place from which random points are within both half angles."""
    rng = np.random.default_rng(3)
    points = rng.normal(0, 1, (500, 3)) * [3, 1, 2]
    place = studio._fit_camera(points, 0.3, 0.2)
    away = points - place
    assert (away[:, 2] < 0).all()
    share = np.abs(away[:, :2]) / -away[:, 2:] / np.array([0.3, 0.2])
    assert share.max() == pytest.approx(1 / studio.MARGIN, rel=1e-9)
    up = studio._least_tangent(points, 0.3)
    place = studio._fit_camera(points, 0.3, up)
    share = np.abs(points - place)[:, :2] / (place[2] - points[:, 2:]) / np.array([0.3, up])
    assert share.max(axis=0) == pytest.approx(1 / studio.MARGIN, rel=1e-6)


@pytest.mark.parametrize("wide", [0.4, 1.0, 2.5], ids=["free", "shifted", "too wide"])
def test_content_leaves_the_corner_of_the_legend_free(wide: float) -> None:
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    right, below = -0.25, 0.1
    with studio.studio((640, 360), 1) as place:
        data = bpy.data.meshes.new("content")
        points = np.random.default_rng(1).uniform([-wide, -0.1, -1.0], [wide, 0.1, 1.0], (400, 3))
        data.from_pydata(points.tolist(), [], [])
        place.add_data(data)
        place.set_up((0.0, -1.0, 0.0))
        place.scene.view_layers[0].update()

        def seen() -> np.ndarray:
            """Positions in the picture, from its centre in its widths."""
            there = [world_to_camera_view(place.scene, place.scene.camera, Vector(point)) for point in points]
            return (np.array(there)[:, :2] - 0.5) * [1.0, 360 / 640]

        before = seen()
        place.clear_corner(right, below)
        after = seen()
        shift = after - before
        assert np.abs(shift - shift[0]).max() < 1e-6 and abs(shift[0, 1]) < 1e-6 and np.abs(after[:, 0]).max() < 0.5
        covered = [(at[:, 0] < right - 1e-6) & (at[:, 1] > below) for at in (before, after)]
        assert covered[0].any() == (wide > 0.4) and (shift[0, 0] > 0.01) == (wide == 1.0)
        assert covered[1].any() == (wide == 2.5)


def test_frames_of_the_animation(piece: Any, tmp_path: Path) -> None:
    piece.flexmaps.film.seconds = 2.0
    piece.flexmaps.render.film = True
    piece.flexmaps.render.file = str(tmp_path / "frames" / "film.png")
    with pytest.raises(RuntimeError, match="press Animate"):
        bpy.ops.flexmaps.render()
    scene = bpy.context.scene
    scene.render.fps, scene.frame_end = 2, 1
    press("animate")
    before = everything()
    piece.flexmaps.render.pixels_x = 64
    press("render")
    assert everything() == before
    frames = sorted((tmp_path / "frames").glob("film-*.png"))
    assert len(frames) == scene.frame_end - scene.frame_start + 1 >= 4
    first, last = pixels(frames[0]), pixels(frames[-1])
    assert first.shape == (36, 64, 3) and np.abs(first - last).max() > 0.2
    if bpy.app.build_options.codec_ffmpeg:
        piece.flexmaps.render.file = str(tmp_path / "film.mp4")
        press("render")
        assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"  # ISO base media file


def test_an_unsaved_file_needs_a_whole_path(piece: Any) -> None:
    with pytest.raises(RuntimeError, match="Save the"):
        bpy.ops.flexmaps.render()


def test_with_connectors(piece: Any, tmp_path: Path) -> None:
    """Flat panels with and without: their seams are drawn otherwise, and little else."""
    piece.flexmaps.connect.connector = "dovetail"
    params = RenderParams(**SMALL, pixels_y=192, target=False, assembled=False)
    seen = []
    for joined in (False, True):
        piece.flexmaps.preview.joined = joined
        picture.render_together(piece, tmp_path / "a.png", params)
        seen.append(pixels(tmp_path / "a.png"))
    changed = np.abs(seen[1] - seen[0]).max(axis=2) > 0.1
    assert 0.0 < changed.mean() < 0.2


def test_a_second_blender_makes_the_same_picture(piece: Any, tmp_path: Path) -> None:
    """And nothing is left in this one, whether it ends or is stopped."""
    from flexmaps.bridge.hosts import second_render
    from flexmaps.engine.errors import Cancelled
    from flexmaps.engine.progress import Progress

    before, params = everything(), RenderParams(**SMALL)  # type: ignore[arg-type]
    pack, made, told = tmp_path / "scene.blend", tmp_path / "made", list[str]()
    picture.render_together(piece, made / "all.png", params, pack)
    assert everything() == before and pack.is_file()
    found = second_render.render(pack, made, 0, Progress(lambda _, text: told.append(text)))
    assert [one.name for one in found] == ["all.png"] and "Setting up the picture" in told
    picture.render_together(piece, tmp_path / "here.png", params)
    apart = np.abs(pixels(found[0]) - pixels(tmp_path / "here.png"))
    assert apart.mean() < 0.005 and np.ptp(pixels(found[0])) > 0.5

    def stopped() -> bool:
        return True

    with pytest.raises(Cancelled):
        second_render.render(pack, tmp_path / "other", 0, Progress(stopped=stopped))
    pack.write_bytes(b"no file of Blender's")
    with pytest.raises(FlexMapsError, match="could not be made"):
        second_render.render(pack, tmp_path / "third", 0, Progress())
