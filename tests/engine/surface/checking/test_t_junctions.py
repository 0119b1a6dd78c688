"""Which vertices on border edges are T-junctions: none where plates only touch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flexmaps.engine.surface.checking.overlaps import overlap_findings
from flexmaps.engine.surface.checking.sewing import sew
from flexmaps.engine.surface.checking.t_junctions import t_junctions
from flexmaps.engine.surface.checking.topology import sides_of
from flexmaps.engine.surface.mesh import PolygonMesh
from flexmaps.engine.surface.remeshing.bodies import concatenate_meshes


def codes(mesh: PolygonMesh) -> set[str]:
    return {one.code for one in overlap_findings(mesh)}


def plates_at_an_edge(counts: tuple[int, ...], angles: tuple[float, ...]) -> PolygonMesh:
    """Plates that meet at a common edge, each divided into another number of quads along it, as quad remeshes leave them."""
    plates = []
    for count, angle in zip(counts, np.radians(angles), strict=True):
        along, out = np.meshgrid(np.linspace(0.0, 1.0, count + 1), np.linspace(0.0, 1.0, 4), indexing="ij")
        points = np.stack([out * np.cos(angle), along, out * np.sin(angle)], axis=-1).reshape(-1, 3)
        first = (4 * np.arange(count)[:, None] + np.arange(3)).ravel()
        rows = np.stack([first, first + 4, first + 5, first + 1], axis=1)
        plates.append(PolygonMesh(points, rows.ravel(), np.full(len(rows), 4)))
    return concatenate_meshes(plates)


@pytest.mark.parametrize(
    "angles", [(0, 90, 180), (90, 210, 330), (0, 90, 180, 270), (0, 30, 180)], ids=["T", "Y", "X", "wedge"]
)
def test_plates_that_meet_at_an_edge_have_no_t_junctions(angles: tuple[float, ...]) -> None:
    """Joined, they would have an edge of three faces; two of them alone could be joined."""
    counts = (5, 7, 11, 6)[: len(angles)]
    plates = plates_at_an_edge(counts, angles)
    assert not codes(plates) and sew(plates) is plates
    ends = plates_at_an_edge((counts[0], counts[-1]), (angles[0], angles[-1]))
    assert codes(ends) == {"t-junction"}


def test_t_junctions_beside_a_short_fin_are_found() -> None:
    """A third plate along a quarter of the seam takes none of the others away."""
    plates = plates_at_an_edge((5, 7), (0, 180))
    fin = plates_at_an_edge((3,), (90,))
    fin = replace(fin, vertices=fin.vertices * [0.2, 0.25, 0.2])
    found = t_junctions(concatenate_meshes([plates, fin]), sides_of(concatenate_meshes([plates, fin])))
    alone = t_junctions(plates, sides_of(plates)).vertex
    beyond = alone[plates.vertices[alone, 1] > 0.3]
    assert len(beyond) and set(beyond.tolist()) <= set(found.vertex.tolist())
