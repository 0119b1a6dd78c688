"""Labels beside panels: legible, in the waste, and each with a tick to its joint."""

import numpy as np
import pytest
import shapely
from flexmaps.engine.fabrication import sheets
from flexmaps.engine.fabrication.panels import lettering
from flexmaps.engine.fabrication.panels.labels import seam_labels
from flexmaps.engine.params import SheetParams, SpiralParams
from flexmaps.engine.spirals import fabricable
from flexmaps.engine.spirals.curves.arcs import Curve
from flexmaps.engine.spirals.curves.spiral import centre_line


def _polygon(panel):
    return shapely.Polygon(panel.outline.sample(1e-6), [h.sample(1e-6) for h in panel.holes])


def _legible(strokes, text, place):
    """Whether some strokes are that text in letters of 2 mm, and a tick that ends nearer to a place than it begins."""
    letters, tick = strokes[:-1], strokes[-1]
    height = max(np.ptp(s[:, 1]) for s in letters)
    ends = np.linalg.norm(tick - place, axis=1)
    return height == pytest.approx(0.002) and len(letters) == len(lettering.text_strokes(text)) and ends[1] < ends[0]


def test_small_labels_stand_beside_their_panels_too(flat_grid):
    """Every joint whose label is hardly read is named in the waste, off all panels, and its tick points at it."""
    narrow = fabricable.uniform_design(
        flat_grid(4, 5, 0.02, cut=lambda x, y: x == 2 or y == 2), SpiralParams(), width=0.001
    )
    made = sheets.make_sheets(narrow, SheetParams(nesting="FAST"))
    panels = made.panels_on_sheet(0)
    material = shapely.union_all([_polygon(p) for p in panels])
    names = seam_labels(narrow.flat.layout)
    tips = centre_line(narrow.arms, np.zeros((len(narrow.width), 4, 1)))[0][:, :, 0]
    for k, placed in enumerate(panels):
        strokes = [s.points for s in placed.waste_labels]
        assert all(not material.intersects(shapely.LineString(s)) for s in strokes)
        letters = [shapely.LineString(s.points) for s in placed.waste_labels if len(s.points) > 2]
        assert min(shapely.distance(material, letters)) > 0.4 * made.params.spacing
        own = [(q, side) for q, side in names if narrow.flat.layout.patch_of[q] == placed.patch]
        assert own
        turn, shift = float(made.packing.rotation[k]), made.packing.shift[k]
        for q, side in own:
            text = names[q, side]
            count = len(lettering.text_strokes(text)) + 1
            runs = [strokes[i : i + count] for i in range(len(strokes) - count + 1)]
            place = Curve(tips[q, side][None], np.zeros(1), closed=False).transform(turn, shift).points[0]
            assert any(_legible(run, text, place) and np.linalg.norm(run[-1][1] - place) < 0.004 for run in runs), (
                k,
                text,
            )
