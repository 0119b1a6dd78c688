"""Forms of SVG 1.1 and 2 as remnants: sizes worked out by hand from the standard, to 0.01 mm."""

from __future__ import annotations

from pathlib import Path

import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.fabrication.nesting import remnants

NAMES = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
PLAIN = 'width="300mm" height="200mm" viewBox="0 0 300 200"'
RECT = '<rect x="10" y="10" width="200" height="100"/>'
PX = 25.4 / 96  # millimetres of a pixel

# name: attributes of the drawing, what it holds, and width, height, and number of holes of its pieces
FORMS = {
    "rect": (PLAIN, RECT, [(200, 100, 0)]),
    "rounded rect": (PLAIN, '<rect width="200" height="100" rx="20"/>', [(200, 100, 0)]),
    "circle": (PLAIN, '<circle cx="100" cy="100" r="50"/>', [(100, 100, 0)]),
    "ellipse turned": (PLAIN, '<ellipse rx="80" ry="40" transform="rotate(90)"/>', [(80, 160, 0)]),
    "polygon": (PLAIN, '<polygon points="0,0 200 0 200,100 0,100"/>', [(200, 100, 0)]),
    "polyline with a gap of .19": (PLAIN, '<polyline points="0,0 200,0 200,100 0,100 0,0.19"/>', [(200, 100, 0)]),
    "lines": (PLAIN, '<line x2="200"/><line x1="200" x2="200" y2="100"/><line x1="200" y1="100" y2="100"/>'
              '<line y1="100" y2="0"/>', [(200, 100, 0)]),
    "relative path": (PLAIN, '<path d="m10,10h200v100h-200z"/>', [(200, 100, 0)]),
    "arcs": (PLAIN, '<path d="M50 100a50 50 0 1 0 100 0a50 50 0 1 0-100 0z"/>', [(100, 100, 0)]),
    "arc flags run together": (PLAIN, '<path d="M50 100a50 50 0 10100 0a50 50 0 10-100 0z"/>', [(100, 100, 0)]),
    "smooth curves": (PLAIN, '<path d="M0 0C0 40 100 40 100 0S200-40 200 0V100H0Z"/>', [(200, 130, 0)]),
    "quadratic curves": (PLAIN, '<path d="M0 0Q50 40 100 0T200 0V100H0Z"/>', [(200, 120, 0)]),
    "subpaths": (PLAIN, '<path d="M0 0H200V100H0ZM20 20H60V60H20Z"/>', [(200, 100, 1)]),
    "island": (PLAIN, f'{RECT}<rect x="20" y="20" width="80" height="80"/><rect x="40" y="40" width="40" height="40"/>',
               [(200, 100, 1), (40, 40, 0)]),
    "two pieces": (PLAIN, f'{RECT}<rect x="220" y="10" width="50" height="60"/>', [(200, 100, 0), (50, 60, 0)]),
    "drawn twice": (PLAIN, RECT + '<rect x="10.1" y="9.9" width="200" height="100"/>', [(200, 100, 0)]),
    "notch": (PLAIN, f'{RECT}<rect x="190" y="40" width="60" height="30"/>', [(200, 100, 0)]),
    "no viewBox": ('width="300mm" height="200mm"', '<rect width="200mm" height="100"/>', [(200, 100 * PX, 0)]),
    "width alone": ('width="300mm" viewBox="0 0 600 400"', '<rect width="400" height="200"/>', [(200, 100, 0)]),
    "height alone": ('height="20cm" viewBox="0 0 600 400"', '<rect width="400" height="200"/>', [(200, 100, 0)]),
    "capital units": ('width="300MM" height="200MM" viewBox="0 0 300 200"', RECT, [(200, 100, 0)]),
    "inches": ('width="12in" height="8in" viewBox="0 0 12 8"', '<rect width="2" height="4"/>', [(50.8, 101.6, 0)]),
    "points": ('width="720pt" height="360pt" viewBox="0 0 720 360"', '<rect width="72" height="144"/>', [(25.4, 50.8, 0)]),
    "picas": ('width="60pc" height="30pc" viewBox="0 0 60 30"', '<rect width="12" height="24"/>', [(50.8, 101.6, 0)]),
    "pixels": ('width="960px" height="480px" viewBox="0 0 960 480"', '<rect width="96" height="192"/>', [(25.4, 50.8, 0)]),
    "size in style": ('style="width:300mm; height:200mm" viewBox="0 0 300 200"', RECT, [(200, 100, 0)]),
    "meet": ('width="300mm" height="300mm" viewBox="0 0 300 200"', RECT, [(200, 100, 0)]),
    "slice": ('width="300mm" height="400mm" viewBox="0 0 300 200" preserveAspectRatio="xMinYMin slice"',
              '<rect width="100" height="50"/>', [(200, 100, 0)]),
    "aspect none": ('width="300mm" height="400mm" viewBox="0 0 300 200" preserveAspectRatio="none"',
                    '<rect width="200" height="50"/>', [(200, 100, 0)]),
    "nested svg": (PLAIN, f'<svg x="20" width="150" height="100" viewBox="0 0 300 200">{RECT}</svg>', [(100, 50, 0)]),
    "nested svg gives nothing on": (PLAIN, '<svg x="20" y="30" width="150" height="100"><rect width="60" height="50"/></svg>',
                                    [(60, 50, 0)]),
    "percentages": (PLAIN, '<rect width="50%" height="25%"/>', [(150, 50, 0)]),
    "transforms": (PLAIN, f'<g transform="translate(5 5)rotate(90)"><g transform="scale(.5)">{RECT}</g></g>', [(50, 100, 0)]),
    "matrix and skew": (PLAIN, f'<g transform="matrix(0 1 -1 0 9 9)"><g transform="skewX(45)">{RECT}</g></g>', [(100, 300, 0)]),
    "sheared circle": (PLAIN, '<g transform="matrix(1 0 1 1 0 0)"><circle r="50"/></g>', [(100 * 2**0.5, 100, 0)]),
    "sheared and turned": (PLAIN, '<g transform="rotate(90)scale(2 1)skewX(45)"><circle r="30" transform="rotate(20)"/></g>',
                           [(60, 120 * 2**0.5, 0)]),
    "transform in style": (PLAIN, f'<g style="transform:scale(0.5)">{RECT}</g>', [(100, 50, 0)]),
    "transform in a sheet": (PLAIN, f"<style>.h{{transform:scale(0.5)}}</style><g class='h'>{RECT}</g>", [(100, 50, 0)]),
    "transform with units": (PLAIN, f'<g style="transform:translate(10mm,0) rotate(0.25turn)">{RECT}</g>', [(100, 200, 0)]),
    "use": (PLAIN, f'<defs><g id="a">{RECT}</g></defs><use xlink:href="#a" x="5"/>', [(200, 100, 0)]),
    "use of use": (PLAIN, f'<defs><g id="a">{RECT}</g><use id="b" href="#a" transform="scale(.5)"/></defs><use href="#b"/>',
                   [(100, 50, 0)]),
    "symbol": (PLAIN, '<symbol id="a"><rect width="200" height="100"/></symbol><use href="#a"/>', [(200, 100, 0)]),
    "symbol before it is named": (PLAIN, f'<use xlink:href="#a" transform="scale(.5)" x="7" y="-3"/><defs><symbol id="a">{RECT}</symbol></defs>',
                                  [(100, 50, 0)]),
    "symbol with a viewBox": (PLAIN, f'<symbol id="a" viewBox="0 0 300 200">{RECT}</symbol><use href="#a" width="150" height="100"/>',
                              [(100, 50, 0)]),
    "symbol with a viewBox and its own size": (PLAIN, f'<symbol id="a" viewBox="0 0 300 200" width="150" height="100">{RECT}</symbol><use href="#a"/>',
                                               [(100, 50, 0)]),
    "symbol that is moved and scaled by a style": (PLAIN, f'{RECT}<symbol id="a"><rect width="40" height="40"/></symbol>'
                                                   '<use href="#a" x="80" y="80" style="transform: scale(.5)"/>', [(200, 100, 1)]),
    "symbol of a symbol, twice": (PLAIN, '<symbol id="a"><rect width="200" height="100"/></symbol><symbol id="b"><use href="#a"/></symbol>'
                                  '<use href="#b"/><use href="#b" y="110"/>', [(200, 100, 0), (200, 100, 0)]),
    "symbols that are not shown": (PLAIN, f'{RECT}<symbol id="a"><circle cx="50" cy="50" r="20"/></symbol>'
                                   '<use href="#a" display="none"/><g visibility="hidden"><use href="#a"/></g>', [(200, 100, 0)]),
    "transform about an origin": (PLAIN, f'{RECT}<g transform="rotate(90)" transform-origin="60 60">'
                                  '<rect x="50" y="50" width="20" height="20"/></g>', [(200, 100, 1)]),
    "transform about an origin in style": (PLAIN, f'{RECT}<g style="transform: rotate(90deg); transform-origin: 60px 60px">'
                                           '<rect x="50" y="50" width="20" height="20"/></g>', [(200, 100, 1)]),
    "marker, pattern, mask, clipPath": (PLAIN, RECT + "".join(
        f'<{tag}><circle cx="50" cy="50" r="20"/></{tag}>' for tag in ("marker", "pattern", "mask", "clipPath")), [(200, 100, 0)]),
    "switch": (PLAIN, f'<switch><foreignObject requiredExtensions="x"/><g>{RECT}</g><circle r="60"/></switch>', [(200, 100, 0)]),
    "display none": (PLAIN, f'{RECT}<g style="display:none"><circle cx="50" cy="50" r="20"/></g>', [(200, 100, 0)]),
    "display by class": (PLAIN, f'<style>.h{{display:none}}</style>{RECT}<g class="h"><circle cx="50" cy="50" r="20"/></g>',
                         [(200, 100, 0)]),
    "a rule over an attribute": (PLAIN, f"<style>.h {{display: none}}</style>{RECT}<circle class='h' display='inline' cx='50' cy='50' r='20'/>",
                                 [(200, 100, 0)]),
    "style over a rule": (PLAIN, f"<style>#a {{transform: scale(3)}}</style><g id='a' style='transform: scale(.5)'>{RECT}</g>", [(100, 50, 0)]),
    "drawn twice, offset": (PLAIN, RECT + '<rect x="9.82" y="9.82" width="200.36" height="100.36"/>', [(200.36, 100.36, 0)]),
    "visibility": (PLAIN, f'{RECT}<g visibility="hidden"><circle cx="50" cy="50" r="20"/></g>', [(200, 100, 0)]),
    "visible in hidden": (PLAIN, f'<g visibility="hidden"><circle r="60"/><g visibility="visible">{RECT}</g></g>', [(200, 100, 0)]),
    "opacity": (PLAIN, f'{RECT}<g opacity="0"><circle cx="50" cy="50" r="20"/></g>', [(200, 100, 0)]),
    "links, titles, other names": (PLAIN, f'<title>a</title><desc>b</desc><metadata><rect xmlns="x:y"/></metadata><a>{RECT}</a>',
                                   [(200, 100, 0)]),
}  # fmt: skip


# rules of style sheets that are not read
RULES = (
    "g:hover {display: inline}",
    "g > rect {transform: scale(.5)}",
    "g rect {transform: scale(.5)}",
    "[fill='none'] {transform: scale(.5)}",
    "g {display: inline !important}",
    "@media print {g {transform: scale(3)}}",
)


def written(path: Path, head: str, inside: str, before: str = "") -> Path:
    path.write_text(f"{before}<svg {NAMES} {head}>{inside}</svg>", encoding="utf-8")
    return path


@pytest.mark.parametrize("name", FORMS)
def test_a_form_has_its_size(tmp_path: Path, name: str) -> None:
    head, inside, wanted = FORMS[name]
    found = remnants.read_file(written(tmp_path / "form.svg", head, inside))
    assert [(*(1e3 * r.size), len(r.holes)) for r in found] == [pytest.approx(w, abs=0.01) for w in wanted]
    assert not any("unit" in remark for r in found for remark in r.remarks)


def test_entities_of_the_document(tmp_path: Path) -> None:
    before = '<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY w "200">]>'
    path = written(tmp_path / "a.svg", PLAIN, '<rect width="&w;" height="100"/>', before)
    assert 1e3 * remnants.read_file(path)[0].size == pytest.approx([200, 100], abs=0.01)


@pytest.mark.parametrize(
    "head", ["", 'viewBox="0 0 300 200"', 'width="300" height="200"', 'width="100%" viewBox="0 0 300 200"']
)
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("in", 25.4), ("px", PX)])
def test_lengths_without_a_unit(tmp_path: Path, head: str, unit: str, scale: float) -> None:
    inside = f'{RECT}<circle cx="9mm" cy="9mm" r="9mm" transform="translate(400)"/>'
    found = remnants.read_file(written(tmp_path / "bare.svg", head, inside), unit)
    large = max(found, key=lambda r: r.size[0])
    assert 1e3 * large.size == pytest.approx([200 * scale, 100 * scale], abs=0.01)
    assert any(1e3 * r.size == pytest.approx([18, 18], abs=0.01) for r in found)
    assert large.remarks == (f"bare.svg names no unit: its lengths are read as {unit}",)


@pytest.mark.parametrize(
    ("inside", "says"),
    [
        ("<text>a</text>", "text, which is not read"),
        ('<image width="200" height="100"/>', "image, which is not read"),
        ('<use id="a" href="#b"/><use id="b" href="#a"/>', "cannot be read as SVG"),
        ('<g id="a"><use href="#a"/></g>', "cannot be read as SVG"),
        ('<symbol id="a"><use href="#a"/></symbol><use href="#a"/>', "cannot be read as SVG"),
    ],
)
def test_what_is_not_read_is_named(tmp_path: Path, inside: str, says: str) -> None:
    with pytest.raises(FlexMapsError, match=says):
        remnants.read_file(written(tmp_path / "a.svg", PLAIN, inside))


@pytest.mark.parametrize(
    ("inside", "says"),
    [
        (f'<clipPath id="c"/><g clip-path="url(#c)">{RECT}</g>', "clip-path"),
        (f'<g style="transform-origin:center">{RECT}</g>', "transform-origin"),
        *((f"<style>.a{{fill:none}} {rule}</style>{RECT}", "style") for rule in RULES),
    ],
)
def test_what_may_change_the_form_is_remarked(tmp_path: Path, inside: str, says: str) -> None:
    (found,) = remnants.read_file(written(tmp_path / "a.svg", PLAIN, inside))
    assert found.remarks == (f"a.svg holds what is not read: {says}",)
