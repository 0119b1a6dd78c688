"""What the page holds: how near it is to what was simulated, how large it is, and that no name gets out of its place."""

from __future__ import annotations

import json
import re
import zlib
from base64 import b64decode, b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser

import numpy as np
import pytest
from flexmaps.engine.display.panel_mesh import make_panel_mesh
from flexmaps.engine.display.skin import Skin, choose_detail
from flexmaps.engine.fabrication.panels.labels import panel_name, seam_labels, seam_name
from flexmaps.engine.materials import MATERIALS
from flexmaps.engine.mechanics.arms.bent import bend_arms
from flexmaps.engine.mechanics.assembly import Pose
from flexmaps.engine.params import ObjectSettings, with_values
from flexmaps.engine.patches.joining import assembly_steps, panel_numbers
from flexmaps.engine.runs import job, page_data, report, report_page, share_page
from flexmaps.engine.runs.page_data import ArrayPacker, ViewContent
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.mesh import PolygonMesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

SETTINGS = with_values(ObjectSettings(), {"page.coming": "AT_ONCE"})
NASTY = "</script><script>alert(1)</script><!-- & \u2028 ]]> <b>\"'"


def unpacked(listed, block):
    """The arrays (rows, columns) of an inflated block."""
    found = {}
    for name, one in listed.items():
        count = one["rows"] * one["columns"]
        data = np.frombuffer(block, np.uint8, count * one["bytes"], one["at"]).reshape(one["bytes"], count)
        steps = np.ascontiguousarray(data.T).view(f"<i{one['bytes']}").astype(np.int64)
        found[name] = steps.reshape(one["rows"], one["columns"]).cumsum(axis=0) * one["step"]
    return found


def result(name: str, until: str = "simulate"):
    return job.run(PolygonMesh.from_quads(shapes.make(name)), SETTINGS, stop_after=until)


@pytest.fixture(scope="module")
def dome():
    return result("dome")


@pytest.fixture(scope="module")
def large():
    """1,088 spirals."""
    return result("three_holes")


def read(text: str):
    """The mapping and its arrays, as a page reads them."""
    made = json.loads(text)
    return made, unpacked(made["arrays"], zlib.decompress(b64decode(made["block"])))


class Page(HTMLParser):
    """Scripts with their types, texts elsewhere, and all addresses."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.texts: list[str] = []
        self.links: list[str | None] = []
        self.meta: list[dict[str, str | None]] = []
        self._script: dict[str, str | None] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value for name, value in attrs if name in ("src", "href", "data", "xlink:href", "action")]
        if tag == "script":
            self._script = dict(attrs)
        if tag == "meta":
            self.meta.append(dict(attrs))

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self._script = None

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.scripts.append((self._script, data))
        else:
            self.texts.append(data)


# -- numbers ---------------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    st.lists(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3), max_size=12), st.sampled_from([1e-3, 0.01, 1.0])
)
def test_packed_numbers_come_back_to_half_a_step(rows, step):
    values = np.array(rows).reshape(-1, 3)
    packed = ArrayPacker()
    packed.add("before", np.arange(5))
    packed.add("it", values, step)
    found = unpacked(packed.listed, zlib.decompress(b64decode(packed.block())))
    assert found["it"].shape == (values.shape if len(values) else (0, 1))
    if len(values):
        assert np.abs(found["it"] - values).max() <= 0.5 * step * (1 + 1e-9)
    assert found["before"].ravel().tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("name", ["dome", pytest.param("large", marks=pytest.mark.thorough)])
def test_what_is_packed_is_within_a_twentieth_of_a_millimetre(name, request):
    """Of the simulated pose and its elastic arms: hubs, and corners of the arms."""
    found = request.getfixturevalue(name)
    made, arrays = read(page_data.to_json(ViewContent.from_result(found), SETTINGS, "it"))
    pose, count = found.simulation.equilibrium.pose, len(found.mesh.quads)
    centres, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    patch = arrays["patch"].ravel().astype(int)
    for track in made["tracks"]:
        hubs, panel = np.flatnonzero(patch == track["panel"]), track["panel"]
        turn = Rotation.from_quat(track["turns"][-1]).as_matrix()
        own = arrays[f"centres {panel}"][-1].reshape(-1, 3)
        centres[hubs] = own @ turn.T + track["places"][-1]
        rotations[hubs] = turn @ Rotation.from_quat(arrays[f"turns {panel}"][-1].reshape(-1, 4)).as_matrix()
    assert np.abs(centres - 1e3 * pose.centres).max() < 0.05
    true = Skin.from_design(found.design, pose)
    arm = np.repeat(np.arange(4 * count), arrays["sections"].ravel().astype(int))
    assert (arm == true.arm).all()
    left, right = 1e-3 * arrays["flat"][:, :2], 1e-3 * arrays["flat"][:, 2:]
    skin = replace(
        true, share=arrays["share"].ravel(), left=left, right=right, tip=1e-3 * arrays["tip"], axis=arrays["axis"].ravel(),
        way=1e-3 * arrays["way"], turn=arrays["turn"],
    )  # fmt: skip
    here, closed = Pose(1e-3 * centres, rotations), (true.partner >= 0).astype(float)
    corners = replace(skin, final_motion=skin.tip_motions(here, closed)).corners_at_pose(
        here, closed, 1e-3 * made["thickness"]
    )
    panels = make_panel_mesh(found.design, choose_detail(found.design))
    drawn = np.full((4 * len(panels.arm), 3), np.nan)
    used = panels.kept_vertices < len(drawn)
    drawn[panels.kept_vertices[used]] = panels.vertices_at_pose(bend_arms(found.design, pose), pose)[used]
    assert 1e3 * np.nanmax(np.linalg.norm(corners.reshape(-1, 3) - drawn, axis=1)) < 0.05


@pytest.mark.thorough
def test_a_thousand_spirals_take_less_than_three_megabytes(large):
    assert len(large.mesh.quads) > 1000
    text = page_data.to_json(
        ViewContent.from_result(large), ObjectSettings(), "it"
    )  # with the stages, which take the most
    assert len(share_page.render_share_page(text, "it", {}, {})) < 3e6


def test_panels_seams_and_joints_are_those_of_the_sheets(dome):
    made, arrays = read(page_data.to_json(ViewContent.from_result(dome), SETTINGS, "it"))
    layout = dome.flat.layout
    assert [panel["name"] for panel in made["panels"]] == [panel_name(panel["step"] + 1) for panel in made["panels"]]
    assert sorted(panel["step"] for panel in made["panels"]) == list(range(len(layout.patches)))
    names = seam_labels(layout)
    told = {(arm // 4, arm % 4): name for step in made["seams"] for seam in step for arm, name in seam["joints"]}
    assert told.items() <= names.items()
    assert set(told.values()) == set(names.values())  # the same on both sides
    assert arrays["joints"].shape == (int((~layout.mesh.border).sum()), 2)


def test_colours_are_the_values_that_the_maps_show(dome):
    made, arrays = read(page_data.to_json(ViewContent.from_result(dome), SETTINGS, "it"))
    measured = report_page.collect_values(dome)
    scales = {one["name"]: one for one in made["colourings"]}
    assert set(scales) == {"distance", "strain", "stiffness"}
    for name, values in (("distance", measured.distance), ("strain", 100 * measured.strain)):
        one = scales[name]
        shown = one["low"] + arrays[name].ravel() * (one["high"] - one["low"])
        assert np.abs(shown - values).max() <= 0.51 * (one["high"] - one["low"]) / page_data.SHADES


def test_stiffness_goes_with_the_third_power_of_the_thickness(dome):
    """As that of flat bars does (E w t^3), where arms are several times as wide as thick."""
    made, pom = dome.design, MATERIALS["pom"]
    thin, more = (replace(made, params=replace(made.params, thickness=x)) for x in (0.2e-3, 0.21e-3))
    ratio = page_data.spiral_stiffness(more, pom) / page_data.spiral_stiffness(thin, pom)
    assert np.log(ratio) / np.log(1.05) == pytest.approx(np.full(len(ratio), 3.0), abs=0.2)


def test_what_was_not_simulated_lies_flat(dome):
    found = ViewContent.from_result(dome.without("simulation"))
    made, arrays = read(page_data.to_json(found, SETTINGS, "it"))
    assert not made["simulated"] and made["length"] == 0.0
    assert [one["name"] for one in made["colourings"]] == ["stiffness"]
    for track in made["tracks"]:
        hubs = dome.flat.layout.patches[track["panel"]]
        own = arrays[f"centres {track['panel']}"].reshape(-1, 3)
        flat = 1e3 * dome.design.arms.centre[hubs]
        assert own[:, :2] - own[0, :2] == pytest.approx(flat - flat[0], abs=0.02)
        assert np.ptp(own[:, 2]) == 0.0


def test_values_that_were_spoilt_have_no_colours(dome):
    found = ViewContent.from_result(dome)
    spoilt = replace(found.measured, distance=np.full(len(dome.mesh.quads), np.nan))
    made, _ = read(page_data.to_json(replace(found, measured=spoilt), SETTINGS, "it"))
    assert {one["name"] for one in made["colourings"]} == {"strain", "stiffness"}


@pytest.mark.parametrize("name", ["quad", pytest.param("two_bodies", marks=pytest.mark.thorough)])
def test_the_smallest_piece_and_one_of_two_bodies(name):
    found = result(name, "spirals" if name == "quad" else "simulate")
    made, arrays = read(page_data.to_json(ViewContent.from_result(found), ObjectSettings(), "it"))
    assert len(made["tracks"]) == len(made["panels"]) == len(made["seams"]) == len(found.flat.layout.patches)
    assert arrays["sections"].shape == (4 * len(found.mesh.quads), 1)


def test_without_spirals_there_is_no_view():
    assert ViewContent.from_result(result("quad", "merge")) is None


def test_spirals_that_the_model_does_not_know_have_no_stiffness(dome):
    assert (
        page_data.spiral_stiffness(
            replace(dome.design, width=np.full_like(dome.design.width, np.nan)), MATERIALS["pom"]
        )
        is None
    )


# -- names -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["share", "report"])
def test_no_name_gets_out_of_its_place(dome, kind):
    text = page_data.to_json(ViewContent.from_result(dome), SETTINGS, NASTY)
    assert "<" not in text and json.loads(text)["title"] == NASTY
    described = report.build_report(dome, source=NASTY + ".obj", settings=SETTINGS)
    if kind == "share":
        whole = share_page.render_share_page(text, NASTY, described, {})
    else:
        whole = report_page.render_page(described, {}, (), "", text)
    page = Page(whole)
    assert len(page.scripts) == 1 + len(share_page.SCRIPTS)
    assert [kind.get("type") for kind, _ in page.scripts if kind.get("type") == "application/json"] == [
        "application/json"
    ]
    assert not any("alert(1)" in body for kind, body in page.scripts if kind.get("type") != "application/json")
    assert any(NASTY in each for each in page.texts)


def test_the_page_allows_its_own_scripts_and_nothing_else(dome):
    whole = share_page.render_share_page(page_data.to_json(ViewContent.from_result(dome), SETTINGS, "it"), "it", {}, {})
    page = Page(whole)
    policy = next(meta["content"] for meta in page.meta if meta.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none'")
    bodies = [body for kind, body in page.scripts if kind.get("type") != "application/json"]
    wanted = {f"'sha256-{b64encode(sha256(body.encode()).digest()).decode()}'" for body in bodies}
    assert set(policy.partition("script-src ")[2].split()) == wanted
    assert not page.links
    # names, no addresses: three.js makes elements of HTML, and says where it comes from
    addresses = set(re.findall(r"https?://[\w./]+", whole))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xhtml", "https://threejs.org"}


def test_all_steps_are_there_on_paper(dome):
    shown = ViewContent.from_result(dome)
    text = page_data.to_json(shown, SETTINGS, "it")
    layout = dome.design.flat.layout
    words = share_page.steps_in_words(text)
    assert len(words) == len(layout.patches)
    order, numbers = assembly_steps(layout), panel_numbers(layout)
    for number, (step, said) in enumerate(zip(order, words, strict=True)):
        assert said.startswith(f"{'Add' if number else 'Take'} panel {panel_name(number + 1)}")
        for join in step.joins:
            where = "within the panel" if join.other == step.panel else f"to panel {panel_name(numbers[join.other])}"
            assert f"{seam_name(join.seam)} {where} ({join.joints} joint" in said
    whole = share_page.render_share_page(text, "it", {}, {})
    assert whole.count("<li>") >= len(words) and "@media print" in whole


def test_the_library_carries_its_licence_and_version(root):
    licence = (share_page.FOLDER / "three.LICENSE.txt").read_text(encoding="utf-8")
    wanted = json.loads((root / "tools" / "page_library" / "package.json").read_text(encoding="utf-8"))
    version = wanted["dependencies"]["three"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", version) and licence.startswith(f"three.js {version}\n")
    body = licence.partition("\n\n")[2].strip()
    assert body.startswith("The MIT License") and body in (share_page.FOLDER / "three.min.js").read_text(
        encoding="utf-8"
    )
