"""The page in a real browser, at the size of a desktop and of a phone; pictures of it are left in out/page to look at."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from flexmaps.engine.display.panel_mesh import make_panel_mesh
from flexmaps.engine.display.rim_mesh import RimMesh
from flexmaps.engine.display.skin import choose_detail
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.params import ObjectSettings, with_values
from flexmaps.engine.runs import job, page_data, report, report_page
from flexmaps.engine.runs.result import Result
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh

PICTURES = Path(__file__).resolve().parents[2] / "out" / "page"
READY = "window.flexmaps || document.querySelector('.needed')"
# reading a pixel waits until all is drawn
DRAWN = """(() => { const gl = flexmaps.page.view.renderer.getContext();
                    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); })()"""
SETTINGS = with_values(ObjectSettings(), {"spiral.border": "rim"})
SIZES = ("desktop", "phone")
DESKTOP = ("desktop", pytest.param("phone", marks=pytest.mark.thorough))
pytestmark = pytest.mark.timeout(600)  # drawn by software, maybe on a busy machine


def result(name: str) -> Result:
    return job.run(PolygonMesh.from_quads(shapes.make(name)), SETTINGS, stop_after="simulate", supports="lowest")


def written(found: Result, folder: Path, name: str) -> Path:
    """The folder with both pages of a result."""
    shown = page_data.ViewContent.from_result(found)
    assert shown is not None
    described = report.build_report(found, source=f"{name}.obj", settings=SETTINGS)
    drawn = report_page.draw_plots(found, described, SETTINGS.layout.distortion_limit)

    def new(path: Any) -> Path:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        return Path(path)

    report_page.write_page(described, drawn, folder, new, piece=page_data.to_json(shown, SETTINGS, name))
    return folder


@pytest.fixture(scope="session")
def piece(merge_without_prediction: None, quick_nesting: None) -> Result:
    return result("demo")


@pytest.fixture(scope="session")
def folder(piece: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(piece, tmp_path_factory.mktemp("demo"), "Canopy")


@pytest.fixture(scope="session")
def flat_folder(piece: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(piece.without("simulation"), tmp_path_factory.mktemp("flat"), "Canopy")


def clean(page: Any, path: Path) -> None:
    """Nothing on the console, and nothing asked for but the page itself (and what is inside it)."""
    assert page.messages == []
    assert [url for url in page.requests if not url.startswith("data:")] == [path.resolve().as_uri()]


def choose(page: Any, name: str) -> None:
    page.evaluate(f"document.querySelector('[name=colour][value={name}]').click()")


def moved(page: Any, name: str, value: float) -> None:
    """Move a slider as a hand does."""
    page.evaluate(
        f"(() => {{ const s = document.querySelector('[name={name}]'); s.value = {value};"
        "s.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )
    page.settle()


# -- what is shown ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", DESKTOP)
def test_the_slider_leads_from_flat_panels_to_the_simulated_hubs(
    browser: ModuleType, piece: Result, folder: Path, size: str
) -> None:
    assert piece.simulation is not None and piece.design is not None
    pose = piece.simulation.equilibrium.pose
    with browser.Browser(size) as page:
        page.open(folder / "share.html", ready=READY)
        clean(page, folder / "share.html")
        page.picture(PICTURES / f"share-{size}.png")
        slider = "document.querySelector('[name=way]')"
        assert page.evaluate(f"Number({slider}.value) === Number({slider}.max)")
        ends = np.array(page.evaluate("flexmaps.hubs()")).reshape(-1, 3)
        assert np.abs(ends - 1e3 * pose.centres).max() < 0.05
        corners = np.array(page.evaluate("flexmaps.corners()")).reshape(-1, 3)
        panels = make_panel_mesh(piece.design, choose_detail(piece.design))
        drawn = np.full((4 * len(panels.arm), 3), np.nan)
        used = panels.kept_vertices < len(drawn)
        arms = panels.vertices_at_pose(bend_arms(piece.design, pose), pose)[: len(used)]  # the rim's plates follow
        drawn[panels.kept_vertices[used]] = arms[used]
        assert 1e3 * np.nanmax(np.linalg.norm(1e-3 * corners[: len(drawn)] - drawn, axis=1)) < 0.05
        rim = RimMesh.from_design(piece.design)
        assert rim is not None
        order = np.argsort(rim.quad, kind="stable")
        place, up = (values[order] for values in rim.points_at_pose(bend_arms(piece.design, pose)))
        lift = 0.5 * piece.design.params.thickness * up
        strip = corners[len(drawn) + 2 * len(pose.centres) :].reshape(-1, 2, 3)
        assert np.abs(strip - 1e3 * np.stack([place + lift, place - lift], axis=1)).max() < 0.05
        moved(page, "way", 0.0)
        flat = np.array(page.evaluate("flexmaps.hubs()")).reshape(-1, 3)
        for quads in piece.design.flat.layout.patches:
            own, wanted = flat[quads], 1e3 * piece.design.arms.centre[quads]
            assert np.ptp(own[:, 2]) < 0.02
            assert own[:, :2] - own[0, :2] == pytest.approx(wanted - wanted[0], abs=0.05)
        page.picture(PICTURES / f"share-{size}-flat.png")
        length = page.evaluate("flexmaps.length")
        moved(page, "way", 0.6 * length)
        page.picture(PICTURES / f"share-{size}-between.png")
        page.click("[name=play]")  # reduced motion is asked for, but who presses play wants to see it
        page.wait("document.querySelector('[name=play]').getAttribute('aria-pressed') === 'false'")
        again = np.array(page.evaluate("flexmaps.hubs()")).reshape(-1, 3)
        assert again == pytest.approx(ends)
        clean(page, folder / "share.html")


@pytest.mark.parametrize("size", DESKTOP)
def test_colours_target_and_explode(browser: ModuleType, folder: Path, size: str) -> None:
    with browser.Browser(size) as page:
        page.open(folder / "share.html", ready=READY)
        for name in ("distance", "strain", "stiffness"):
            choose(page, name)
            page.picture(PICTURES / f"share-{size}-{name}.png")
            assert page.evaluate("!document.querySelector('.legend').hidden")
            assert re.match(r"[\d.]+$", page.evaluate("document.querySelector('.legend .high').textContent"))
        choose(page, "panel")
        page.settle()
        assert page.evaluate("document.querySelector('.legend').hidden")
        before = np.array(page.evaluate("flexmaps.corners()"))
        assert not page.evaluate("flexmaps.page.view.target.visible")
        page.evaluate("document.querySelector('[name=target]').click()")
        assert page.evaluate("flexmaps.page.view.target.visible")
        moved(page, "apart", 0.7)
        page.picture(PICTURES / f"share-{size}-exploded.png")
        assert np.abs(np.array(page.evaluate("flexmaps.corners()")) - before).max() > 20.0
        moved(page, "apart", 0.0)
        assert np.array(page.evaluate("flexmaps.corners()")) == pytest.approx(before, abs=1e-3)
        numbers = page.evaluate("[...document.querySelectorAll('.labels .number')].map((each) => each.textContent)")
        assert len(numbers) == page.evaluate("flexmaps.page.piece.panels.length")
        page.evaluate("document.querySelector('[name=numbers]').click()")
        page.settle()
        assert page.evaluate("document.querySelectorAll('.labels .number').length") == 0
        clean(page, folder / "share.html")


def test_a_picture_can_be_saved(browser: ModuleType, folder: Path) -> None:
    with browser.Browser() as page:
        page.open(folder / "share.html", ready=READY)
        size = page.evaluate("flexmaps.page.view.picture().then((blob) => [blob.type, blob.size])")
        assert size[0] == "image/png" and size[1] > 20_000
        kept = page.evaluate(
            "new Promise((done) => { HTMLAnchorElement.prototype.click = function () { done([this.download, this.href]) };"
            "document.querySelector('[name=picture]').click() })"
        )
        assert kept[0] == "Canopy.png" and kept[1].startswith("blob:")
        clean(page, folder / "share.html")


# -- by hand ---------------------------------------------------------------------------------------------------------------

CAMERA = "flexmaps.page.view.camera.position.toArray()"


def test_pointer_and_keys_turn_and_zoom(browser: ModuleType, folder: Path) -> None:
    with browser.Browser() as page:
        page.open(folder / "share.html", ready=READY)
        first = np.array(page.evaluate(CAMERA))
        page.drag(".stage canvas", 120, -40)
        turned = np.array(page.evaluate(CAMERA))
        assert np.linalg.norm(turned - first) > 0.1 * np.linalg.norm(first)
        page.evaluate("document.querySelector('.stage canvas').focus()")
        for key in ("ArrowLeft", "ArrowUp", "+"):
            before = np.array(page.evaluate(CAMERA))
            page.key(key, key if key == "+" else "")
            assert np.linalg.norm(np.array(page.evaluate(CAMERA)) - before) > 0.02 * np.linalg.norm(before)
        page.key("Home")
        assert np.array(page.evaluate(CAMERA)) == pytest.approx(first, rel=1e-3, abs=1.0)
        # every control can be reached and pressed without a pointer
        page.evaluate("document.querySelector('[name=guide]').focus()")
        page.key("Enter", "\r")
        assert page.evaluate("location.hash") == "#step=1"
        unnamed = page.evaluate(
            "[...document.querySelectorAll('button, input')].filter((each) => !each.ariaLabel && !each.textContent.trim()"
            " && !(each.labels && each.labels[0].textContent.trim())).length"
        )
        assert unnamed == 0
        clean(page, folder / "share.html")


def test_fingers_turn_and_pinch(browser: ModuleType, folder: Path) -> None:
    with browser.Browser("phone") as page:
        page.open(folder / "share.html", ready=READY)
        x, y = page.middle(".stage canvas")
        first = np.array(page.evaluate(CAMERA))
        page.touch(((x, y), (x + 90, y)))
        turned = np.array(page.evaluate(CAMERA))
        assert np.linalg.norm(turned - first) > 0.1 * np.linalg.norm(first)
        distance = "flexmaps.page.view.camera.position.distanceTo(flexmaps.page.view.controls.target)"
        before = page.evaluate(distance)
        page.touch(((x - 30, y), (x - 110, y)), ((x + 30, y), (x + 110, y)))
        assert page.evaluate(distance) < 0.8 * before
        assert page.evaluate("scrollY") == 0
        # all of it in one hand: nothing to be scrolled to, nothing wider than the screen, nothing too small for a thumb
        width, height = browser.SIZES["phone"]
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate("document.documentElement.scrollHeight") <= height
        sizes = page.evaluate(
            "[...document.querySelectorAll('button')].filter((each) => each.offsetParent)"
            ".map((each) => [each.offsetWidth, each.offsetHeight])"
        )
        assert min(min(each) for each in sizes) >= 36
        clean(page, folder / "share.html")


# -- the guide -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
def test_the_guide_goes_step_by_step(browser: ModuleType, piece: Result, folder: Path, size: str) -> None:
    assert piece.flat is not None
    with browser.Browser(size) as page:
        page.open(folder / "share.html", ready=READY)
        page.click("[name=guide]")
        count = len(piece.flat.layout.patches)
        for step in range(1, count + 1):
            assert page.evaluate("location.hash") == f"#step={step}"
            assert page.evaluate("document.querySelector('.count').textContent") == f"Step {step} of {count}"
            panel = page.evaluate(f"flexmaps.page.piece.panels.find((each) => each.step === {step - 1}).name")
            assert page.evaluate("document.querySelector('.do').textContent").endswith(f"panel {panel}")
            assert page.evaluate("document.querySelector('.labels .lit').textContent") == panel
            seams = page.evaluate(f"flexmaps.page.piece.seams[{step - 1}].map((each) => each.name)")
            chips = page.evaluate("[...document.querySelectorAll('.seams b')].map((each) => each.textContent)")
            assert chips == seams
            letters = page.evaluate("[...document.querySelectorAll('.labels .letter')].map((each) => each.textContent)")
            assert {re.sub(r"\d", "", each) for each in letters} == set(seams)
            shown = page.evaluate(
                "[...document.querySelectorAll('.labels .letter')].filter((each) => !each.hidden).length"
            )
            assert shown > 0 or not seams
            page.picture(PICTURES / f"guide-{size}-{step}.png")
            if step < count:
                page.click("[name=next]")
        assert page.evaluate("document.querySelector('[name=next]').disabled")
        page.click("[name=previous]")
        assert page.evaluate("location.hash") == f"#step={count - 1}"
        page.click("[name=whole]")
        assert page.evaluate("document.querySelector('.view').dataset.mode") == "view"
        clean(page, folder / "share.html")
        # a reload goes on where the work was
        page.open(folder / "share.html", "#step=2", ready=READY)
        assert page.evaluate("document.querySelector('.count').textContent").startswith("Step 2")
        # an address that somebody has changed
        page.open(folder / "share.html", "#step=999999", ready=READY)
        assert page.evaluate("document.querySelector('.count').textContent") == f"Step {count} of {count}"
        assert page.messages == []


def test_the_next_panel_flies_where_motion_is_wanted(browser: ModuleType, folder: Path) -> None:
    with browser.Browser(still=False) as page:
        page.open(folder / "share.html", "#step=2", ready=READY)
        page.wait("flexmaps.page.playing === 0")
        assert page.evaluate("flexmaps.page.shown") == pytest.approx(2.5)
        clean(page, folder / "share.html")


# -- elsewhere -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", DESKTOP)
def test_the_report_holds_the_piece_too(browser: ModuleType, folder: Path, size: str) -> None:
    with browser.Browser(size) as page:
        page.open(folder / "report.html", ready=READY)
        clean(page, folder / "report.html")
        page.picture(PICTURES / f"report-{size}.png")
        assert page.evaluate("document.documentElement.scrollWidth") <= browser.SIZES[size][0]
        assert page.evaluate("flexmaps.page.skin.quads") > 0
        page.picture(PICTURES / f"report-{size}-whole.png", whole=True)


@pytest.mark.parametrize("size", DESKTOP)
def test_in_the_dark(browser: ModuleType, folder: Path, size: str) -> None:
    with browser.Browser(size, dark=True) as page:
        page.open(folder / "share.html", "#step=2", ready=READY)
        page.picture(PICTURES / f"dark-{size}-guide.png")
        page.open(folder / "report.html", ready=READY)
        page.picture(PICTURES / f"dark-{size}-report.png")
        light = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
        assert max(light[:3]) < 60
        clean(page, folder / "report.html")


@pytest.mark.parametrize("size", DESKTOP)
def test_a_piece_that_was_not_simulated_says_so(browser: ModuleType, flat_folder: Path, size: str) -> None:
    with browser.Browser(size) as page:
        page.open(flat_folder / "share.html", "#step=2", ready=READY)
        assert "not simulated" in page.evaluate("document.querySelector('.side').innerText")
        assert page.evaluate("document.querySelectorAll('[name=way], [name=guide], [name=apart]').length") == 0
        assert page.evaluate("document.querySelector('.view').dataset.mode") == "view"
        assert page.evaluate("flexmaps.page.view.target.visible")
        page.picture(PICTURES / f"flat-{size}.png")
        clean(page, flat_folder / "share.html")


@pytest.mark.parametrize("size", DESKTOP)
def test_without_webgl_there_are_pictures(browser: ModuleType, folder: Path, size: str) -> None:
    with browser.Browser(size, options=("--disable-3d-apis",)) as page:
        page.open(folder / "share.html", ready=READY)
        assert page.evaluate("document.querySelector('#view') === null")
        assert page.evaluate("document.querySelectorAll('.instead svg').length") >= 1
        assert "no 3D" in page.evaluate("document.querySelector('.why').innerText")
        page.picture(PICTURES / f"no-webgl-{size}.png")
        page.open(folder / "report.html", ready=READY)
        assert page.evaluate("document.querySelectorAll('main svg').length") > 3
        assert "no 3D" in page.evaluate("document.querySelector('.why').innerText")
        assert page.messages == []


def test_on_paper_pictures_stand_for_the_view(browser: ModuleType, folder: Path) -> None:
    with browser.Browser() as page:
        page.open(folder / "share.html", ready=READY)
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.evaluate("document.querySelector('.instead svg').clientHeight") > 100


def test_where_scripts_run_the_pictures_are_not_drawn_first(browser: ModuleType, folder: Path) -> None:
    shown = "document.querySelector('.instead').getBoundingClientRect().height"
    early = f"addEventListener('readystatechange', () => {{ window.early ??= {shown} }}, true)"
    with browser.Browser() as page:
        page.call("Page.addScriptToEvaluateOnNewDocument", source=early)
        page.open(folder / "share.html", ready=READY)
        assert page.evaluate("window.early") == 0  # when all was read and the page's own script had not begun
        page.call("Emulation.setScriptExecutionDisabled", value=True)
        page.open(folder / "share.html")
        assert page.evaluate(shown) > 300


@pytest.mark.thorough
def test_how_long_a_thousand_spirals_take(
    browser: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """For a person: the times depend on the machine, so nothing asserts them."""
    found = result("three_holes")
    page_file = written(found, tmp_path, "Three holes") / "share.html"
    empty = tmp_path / "empty.html"
    empty.write_text("<!doctype html><title>empty</title><h1>Empty</h1>")
    figures = {"spirals": len(found.mesh.quads), "megabytes": round(page_file.stat().st_size / 1e6, 2)}
    for size in SIZES:
        with browser.Browser(size) as page:
            page.open(empty)
            page.settle()  # the browser's own start does not count
            start = page.processor()
            page.open(empty)
            page.settle()
            before = page.processor()
            page.open(page_file, ready=READY)
            after = page.processor()
            page.settle()
            page.evaluate(DRAWN)
            drawn = page.processor()
            page.picture(PICTURES / f"large-{size}.png")
            frames = [page.evaluate("flexmaps.frame()") for _ in range(5)]
            shapes_ = [page.evaluate("(() => { const t = performance.now(); flexmaps.at(1.3); return performance.now() - t })()")
                       for _ in range(5)]  # fmt: skip
            figures[size] = {
                "load_s": round(after["renderer"] - before["renderer"], 2),
                "load_with_drawing_s": round(sum(drawn.values()) - sum(before.values()), 2),
                "load_of_empty_page_s": round(sum(before.values()) - sum(start.values()), 2),
                "frames_per_second": round(1e3 / min(frames), 1), "new_shape_ms": round(min(shapes_), 1),
            }  # fmt: skip
            clean(page, page_file)
    (PICTURES / "figures.json").write_text(json.dumps(figures, indent=1))
    with capsys.disabled():
        print(f"\n  {figures['spirals']} spirals, {figures['megabytes']} MB")
        for size in SIZES:
            row: Any = figures[size]
            print(
                f"  {size:8} loads in {row['load_s']} s of processor, {row['load_with_drawing_s']} s with drawing by software "
                f"(an empty page {row['load_of_empty_page_s']} s); "
                f"{row['frames_per_second']} frames a second by software, another shape in {row['new_shape_ms']} ms"
            )
    assert page_file.stat().st_size < 3e6
