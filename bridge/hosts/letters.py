"""Outlines of letters for the PDFs, from Blender's own fonts, which cover most scripts. For the main thread only."""

from __future__ import annotations

import unicodedata

import bpy
import numpy as np

from ...engine.fabrication.writers.glyphs import GlyphOutlines, is_in_helvetica, outlines_by_run, split_runs

END_MARK = "|"  # letter set after a run of text: its left edge marks where the run ends


def add_outlines(*texts: str) -> None:
    """Store outlines of all runs of letters in these texts that the PDFs' own font lacks."""
    for run in {
        run for text in texts for run in split_runs(text) if not is_in_helvetica(run) and run not in outlines_by_run
    }:
        shown = run
        if all(unicodedata.bidirectional(letter) in ("R", "AL", "NSM") for letter in run):
            shown = run[::-1]  # Blender sets letters from left to right, even of scripts that run from right to left
        outlines_by_run[run] = _outlines(shown)


def _outlines(run: str) -> GlyphOutlines:
    bar, both = _splines(END_MARK), _splines(run + END_MARK)
    if not bar or len(both) < len(bar):
        return GlyphOutlines(0.5 * len(run), ())
    width = float(both[-1][:, 1, 0].min() - bar[-1][:, 1, 0].min())
    return GlyphOutlines(width, tuple(both[: len(both) - len(bar)]))


def _splines(text: str) -> list[np.ndarray]:
    """Return closed Bezier splines of a text at font size 1, each (nodes, 3, 2): left handle, node, right handle."""
    data = bpy.data.curves.new("FlexMaps letters", "FONT")
    obj = bpy.data.objects.new("FlexMaps letters", data)
    try:
        data.body, data.size = text, 1.0
        made = obj.to_curve(bpy.context.evaluated_depsgraph_get())
        return [
            np.array([(p.handle_left[:2], p.co[:2], p.handle_right[:2]) for p in spline.bezier_points])
            for spline in made.splines
            if len(spline.bezier_points)
        ]
    finally:
        obj.to_curve_clear()
        bpy.data.objects.remove(obj)
        bpy.data.curves.remove(data)
