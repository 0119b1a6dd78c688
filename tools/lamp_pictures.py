"""The lamp shade of the tutorial made and shown: the pictures of docs/tutorial.md, of the site's front page and of an extension listing.

    python3 tools/dev.py python tools/lamp_pictures.py             # docs/images/hero.jpg and docs/images/tutorial/
    python3 tools/dev.py python tools/lamp_pictures.py --listing   # out/listing: icon, featured picture and previews as the
                                                                   # Blender extensions platform asks for them

Cycles on the processor: some minutes a picture on two cores. Look at them before you commit or upload them.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tools"))
import lamp_shade  # noqa: E402

OUT, LISTING, IMAGES = ROOT / "out" / "lamp", ROOT / "out" / "listing", ROOT / "docs" / "images"
WIDE = (1920, 1080)  # pixels of the listing's featured picture and previews, 16:9
ICON = 256  # pixels of the listing's icon
STEP = (960, 540)  # pixels of the tutorial's pictures
SAMPLES, STUDIO = 12, 8  # rays a pixel in the room and in the studio; the denoiser does the rest, by eye
QUALITY = 84  # of JPEG files in docs/; chosen by eye


def made() -> Any:
    """The lamp shade as a piece with optimised spirals; the one that lies in out/lamp, if it is there. Its sheets lie there, too."""
    from flexmaps import api

    kept = OUT / "piece.blend"
    if not kept.is_file():
        piece = api.sheets(api.optimise(api.layout(api.load(lamp_shade.FILE))))
        api.export(piece, OUT / "sheets")
        (OUT / "report.json").write_text(json.dumps(api.report(piece), indent=1), encoding="utf-8")
        api.save(piece, kept)
    return api.simulate(api.load(kept))  # the file holds where the hubs are, not the whole simulation


# -- in the room -------------------------------------------------------------------------------------------------------


def scene(piece: Any, look: str = "pom") -> tuple[Any, Any, list[Any]]:
    """The room with the assembled piece in the place of the target: the scene, the shade, and its flat panels, each an object of its own."""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.view import materials, picture, preview

    obj, place = lamp_shade.begin()
    api.show(replace(piece, uid=None), obj)
    design = picture.stored_design(obj)
    assert design is not None
    tips = preview.connector_tips(design, piece.settings)
    built = preview.build_piece(design, picture._hub_pose(obj, design), "FINE", tips)
    assert built.panels is not None
    for other in place.objects:
        other.hide_render |= other is obj or "flexmaps_kind" in other
    white = materials.sheet_material(look)
    shade = preview.piece_mesh("Shade", built.panels, built.vertices, None)
    shade.materials.append(translucent(white))
    flat = built.panels.flat_vertices(np.zeros((len(design.flat.layout.patches), 2)))
    panels = [_alone(built.panels, flat, faces, white) for faces in _faces_by_patch(design, built.panels)]
    hanging = bpy.data.objects.new("Shade", shade)
    for one in (hanging, *panels):
        place.collection.objects.link(one)
    return place, hanging, panels


def _faces_by_patch(design: Any, panels: Any) -> list[np.ndarray]:
    of = design.flat.layout.patch_of[panels.quad_of]
    return [of == k for k in range(len(design.flat.layout.patches))]


def _alone(panels: Any, flat: np.ndarray, faces: np.ndarray, look: Any) -> Any:
    """One panel, its middle at the origin, lying on z = 0."""
    import bpy
    from flexmaps.bridge.view import meshes

    corners = panels.corners[np.repeat(faces, panels.sizes)]
    used, index = np.unique(corners, return_inverse=True)
    points = flat[used]
    points = points - np.append(0.5 * (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)), points[:, 2].min())
    data = meshes.make_polygon_mesh("Panel", points, index.ravel(), panels.sizes[faces])
    data.materials.append(look)
    return bpy.data.objects.new("Panel", data)


def translucent(look: Any) -> Any:
    """The sheet's material with some of the lamp's light passing through."""
    made = look.copy()
    made.name = f"{look.name}, lit"
    shader = made.node_tree.nodes["Principled BSDF"]
    nodes, links = made.node_tree.nodes, made.node_tree.links
    through = nodes.new("ShaderNodeBsdfTranslucent")
    through.inputs["Color"].default_value = shader.inputs["Base Color"].default_value
    mix = nodes.new("ShaderNodeMixShader")
    mix.inputs["Fac"].default_value = 0.35
    links.new(shader.outputs["BSDF"], mix.inputs[1])
    links.new(through.outputs["BSDF"], mix.inputs[2])
    links.new(mix.outputs["Shader"], nodes["Material Output"].inputs["Surface"])
    return made


# where the panels lie on the table, metres, and how they are turned, radians; by eye
LYING = ((-0.34, -0.03, 0.12), (-0.31, 0.16, -0.04), (0.0, -0.09, 0.5))
SHADE = (810, 215, 1770, 755)  # where the shade is in the picture from afar, pixels
NEAR = (0.0, -0.70, 0.37), (1.29, 0.0, 0.0)  # camera of the picture from near, metres and radians


def in_the_room(
    piece: Any, path: Path, *, size: tuple[int, int] = WIDE, near: bool = False, samples: int = SAMPLES
) -> None:
    """The shade lit, above its panels; ``near`` shows its spirals."""
    import bpy

    place, _, panels = scene(piece)
    for panel, (x, y, turn) in zip(panels, LYING, strict=True):
        panel.location, panel.rotation_euler = (x, y, 0.0), (0.0, 0.0, turn)
    if near:
        place.camera.location, place.camera.rotation_euler = NEAR
    place.render.resolution_x, place.render.resolution_y = size
    place.cycles.samples = samples
    place.render.filepath = str(path.absolute())
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.render.render(write_still=True, scene=place.name)


# -- in the studio -----------------------------------------------------------------------------------------------------


def step(piece: Any, kind: str, path: Path, size: tuple[int, int]) -> None:
    """Draw one stage with the functions of the sidebar's pictures: target, layout, panels, shape, together."""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.view import picture
    from flexmaps.engine.params import RenderParams

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "target":  # the surface as the file has it
        picture.render_layout(api.show(api.load(lamp_shade.surface())), path, size, STUDIO)
        return
    obj = api.show(replace(piece, uid=None))
    if kind == "together":
        x, y = size
        view = RenderParams(pixels_x=x, pixels_y=y, samples=STUDIO, elevation=np.radians(24.0))
        picture.render_together(obj, path, view)
    else:
        {"layout": picture.render_layout, "panels": picture.render_panels, "shape": picture.render_shape}[kind](
            obj, path, size, STUDIO
        )


def sheet(path: Path, pixels: int) -> None:
    """The sheet as the cutter gets it, from its PDF."""
    import pypdfium2

    page = pypdfium2.PdfDocument(OUT / "sheets" / "sheet-01.pdf")[0]
    path.parent.mkdir(parents=True, exist_ok=True)
    page.render(scale=pixels / page.get_width()).to_pil().convert("RGB").save(path)


def icon(path: Path) -> None:
    """A single spiral of Delrin on orange, with round corners."""
    import bpy
    from flexmaps import api
    from flexmaps.bridge.view import materials, picture, preview
    from PIL import Image, ImageDraw

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    obj = api.show(
        api.spirals(api.load("shape:quad", edge=20, settings={"spiral.twist_min": 250, "spiral.width_max": 1.3}))
    )
    design = picture.stored_design(obj)
    assert design is not None
    with picture.studio((2 * ICON, 2 * ICON), 16) as place:
        built = preview.build_piece(design, picture._hub_pose(obj, design), "FINE")
        assert built.panels is not None
        data = preview.piece_mesh("Spiral", built.panels, built.panels.flat_vertices(np.zeros((1, 2))), None)
        data.materials.append(materials.sheet_material("pom"))
        place.add_data(data)
        place.set_up(picture.ABOVE)
        for other in place.scene.objects:
            if other.name.startswith("FlexMaps ground"):
                shader = other.data.materials[0].node_tree.nodes["Principled BSDF"]
                shader.inputs["Base Color"].default_value = (0.78, 0.16, 0.02, 1.0)
        place.render_picture(path)
    drawn = Image.open(path).convert("RGBA")
    corners = Image.new("L", drawn.size, 0)
    ImageDraw.Draw(corners).rounded_rectangle((0, 0, drawn.width - 1, drawn.height - 1), drawn.width // 5, fill=255)
    drawn.putalpha(corners)
    drawn.resize((ICON, ICON), Image.Resampling.LANCZOS).save(path, optimize=True)


def lit(piece: Any, folder: Path) -> None:
    """Both pictures of the lit shade, unless they are there: they take longest."""
    for name, near in (("featured.png", False), ("preview-1-near.png", True)):
        if not (folder / name).is_file():
            in_the_room(piece, folder / name, near=near)


def listing(piece: Any) -> None:
    """out/listing: icon.png of 256 x 256, featured.png and previews of 1920 x 1080 pixels."""
    from PIL import Image

    folder = LISTING
    folder.mkdir(parents=True, exist_ok=True)
    lit(piece, folder)
    icon(folder / "icon.png")
    for number, kind in enumerate(("together", "shape", "panels"), 2):
        step(piece, kind, folder / f"preview-{number}-{kind}.png", WIDE)
    for path in sorted(folder.glob("*.png")):
        print(f"{path.relative_to(ROOT)}  {Image.open(path).size}  {path.stat().st_size / 1e3:.0f} kB", flush=True)


def pages(piece: Any) -> None:
    """The pictures of docs/: the front page's, of which the listing's featured one serves, and the tutorial's steps."""
    from PIL import Image

    folder = OUT / "pictures"
    for kind in ("target", "layout", "panels", "shape"):
        step(piece, kind, folder / f"{kind}.png", STEP)
    sheet(folder / "sheet.png", STEP[0])
    lit(piece, LISTING)
    whole = Image.open(LISTING / "featured.png")
    whole.save(folder / "hero.png")
    whole.crop(SHADE).save(folder / "near.png")
    for path in sorted(folder.glob("*.png")):
        target = IMAGES / "hero.jpg" if path.stem == "hero" else IMAGES / "tutorial" / f"{path.stem}.jpg"
        target.parent.mkdir(exist_ok=True)
        picture = Image.open(path).convert("RGB")
        picture.thumbnail(WIDE if path.stem == "hero" else (STEP[0], STEP[0]))
        picture.save(target, quality=QUALITY, optimize=True, progressive=True)
        print(f"{target.relative_to(ROOT)}  {target.stat().st_size / 1e3:.0f} kB", flush=True)


def main(argv: list[str]) -> None:
    import flexmaps

    parser = argparse.ArgumentParser(description="Pictures of the tutorial's lamp shade.")
    parser.add_argument("--listing", action="store_true", help="those of an extension listing, into out/listing")
    wanted = parser.parse_args(argv)
    flexmaps.register()
    piece = made()
    (listing if wanted.listing else pages)(piece)


if __name__ == "__main__":
    main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)  # Blender as a module may wait for ever at the end of a process
