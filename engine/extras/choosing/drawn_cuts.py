"""Cuts as a person would draw them: along folds, into equal strips, rings and petals, in mirror planes, symmetric.

A line is a chain of edges that runs straight on through regular vertices. A family of parallel lines consists of the
lines that one strip of quads crosses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Bool, Float, Int
from ...patches.layout import PatchLayout, component_numbers, next_straight_side
from ...patches.tracing.trace import make_disks
from ...surface.checking.folds import SHARP, fold_angles
from ...surface.checking.topology import sides_of
from ...surface.mesh import PolygonMesh, QuadMesh
from ...surface.symmetry import Symmetry, preserved_by, symmetric_closure

MAX_FAMILIES = 4  # largest number of families, those with most edges first; larger: more layouts, more time
# largest share of its lines that a family may have in common with an earlier one; larger: more layouts that are alike
MAX_COMMON_SHARE = 0.7
MAX_SYMMETRIC = (
    2  # largest number of symmetric layouts of each kind, fewest cuts first; larger: more layouts, more time
)
MAX_OPENING_ROUNDS = 3  # largest number of rounds of opening patches and adding symmetric images; mostly one suffices
MIN_LINES = 4  # smallest number of lines of a family: fewer are parallel by coincidence


@dataclass(frozen=True, eq=False)
class LineFamily:
    """Parallel lines of edges: those that one strip of quads crosses.

    lines : indices of the lines, see ``lines_of_edges``, in the order in which the strip crosses them
    at : position of each crossing, metres along the strip
    length : length of the strip, metres; closed : whether the strip ends where it begins
    """

    lines: Int[np.ndarray, " crossed"]
    at: Float[np.ndarray, " crossed"]
    length: float
    closed: bool

    def equal(self, parts: int, first: int = 0) -> Int[np.ndarray, " chosen"]:
        """Return the lines that most nearly divide the strip into equal parts.

        Parameters
        ----------
        parts : number of parts
        first : index of the crossing at which a closed strip is divided first; unused if the strip is open
        """
        if self.closed:
            places = (self.at[first] + self.length * np.arange(parts) / parts) % self.length
        else:
            places = self.length * np.arange(1, parts) / parts
        apart = np.abs(self.at[:, None] - places)
        apart = np.minimum(apart, self.length - apart) if self.closed else apart
        return np.unique(self.lines[apart.argmin(axis=0)])


def lines_of_edges(mesh: QuadMesh) -> Int[np.ndarray, " edges"]:
    """Return (E,) the index of each edge's line; lines end at irregular vertices and at the border."""
    inner = np.flatnonzero(~mesh.border)
    one, two = [], []
    for way in range(2):
        quad, side = mesh.edge_quads[inner, way], mesh.edge_sides[inner, way]
        beyond, across, valid = next_straight_side(mesh, quad, side)
        one.append(inner[valid])
        two.append(mesh.quad_edges[beyond, across][valid])
    return component_numbers(len(mesh.edges), np.concatenate(one), np.concatenate(two))


def find_families(mesh: QuadMesh) -> list[LineFamily]:
    """Return the families of parallel lines of a surface, those with most edges first, without near-duplicates."""
    line_of = lines_of_edges(mesh)
    size = np.bincount(line_of)
    found = [_make_family(mesh, strip, closed, line_of) for strip, closed in _strips(mesh)]
    found = [family for family in found if len(np.unique(family.lines)) >= MIN_LINES]
    found.sort(key=lambda family: -int(size[np.unique(family.lines)].sum()))
    kept: list[LineFamily] = []
    for family in found:
        own = np.unique(family.lines)
        if all(np.isin(own, other.lines).mean() <= MAX_COMMON_SHARE for other in kept):
            kept.append(family)
        if len(kept) == MAX_FAMILIES:
            break
    return kept


def _strips(mesh: QuadMesh) -> Iterator[tuple[list[int], bool]]:
    """Yield each strip of quads as the edges that it crosses, in order, and whether it is closed."""
    seen = np.zeros(len(mesh.edges), dtype=bool)
    # begin at the border, so that no open strip is entered in its middle
    for edge in (*np.flatnonzero(mesh.border).tolist(), *np.flatnonzero(~mesh.border).tolist()):
        if seen[edge]:
            continue
        way = 0 if mesh.edge_quads[edge, 0] >= 0 else 1
        quad, side, walk = int(mesh.edge_quads[edge, way]), int(mesh.edge_sides[edge, way]), [edge]
        seen[edge] = True
        closed = False
        while quad >= 0:
            following = int(mesh.quad_edges[quad, (side + 2) % 4])
            if following == edge:
                closed = True
                break
            if seen[following]:
                break  # a strip that crosses itself
            seen[following] = True
            walk.append(following)
            other = 1 if mesh.edge_quads[following, 0] == quad else 0
            quad, side = int(mesh.edge_quads[following, other]), int(mesh.edge_sides[following, other])
        yield walk, closed


def _make_family(mesh: QuadMesh, strip: list[int], closed: bool, line_of: np.ndarray) -> LineFamily:
    middle = mesh.vertices[mesh.edges[strip]].mean(axis=1)
    steps = np.linalg.norm(np.diff(middle, axis=0, append=middle[:1]), axis=1)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    inner = ~mesh.border[strip]
    length = float(at[-1] if closed else at[-2])
    return LineFamily(line_of[strip][inner], at[:-1][inner], length, closed)


def equal_part_cuts(
    mesh: QuadMesh, most: int, symmetries: Sequence[Symmetry]
) -> Iterator[tuple[str, Bool[np.ndarray, " edges"]]]:
    """Yield divisions into equal strips, rings and petals: name and cut edges, (E,) bool.

    Closed strips are divided first at a line in a mirror plane, if there is one, to keep the symmetry. On a surface
    without border, where the parts would be tubes, the parts are also opened along a line of a second family.

    Parameters
    ----------
    mesh : quad mesh
    most : largest number of parts
    symmetries : symmetries of the mesh
    """
    line_of, found = lines_of_edges(mesh), find_families(mesh)
    plane = np.zeros(int(line_of.max()) + 1, dtype=bool)
    for symmetry in symmetries:
        plane[np.unique(line_of[edges_in_plane(mesh, symmetry)])] = True

    def cut(family: LineFamily, parts: int) -> np.ndarray:
        first = int(plane[family.lines].argmax()) if len(family.lines) else 0
        return np.isin(line_of, family.equal(parts, first)) & ~mesh.border

    for family in found:
        for parts in range(2, min(most, len(family.lines)) + 1):
            yield f"{parts} equal parts", cut(family, parts)
    if not mesh.border.any():
        for one in found:
            for two in found:
                if one is not two and not np.isin(one.lines, two.lines).any():
                    for parts in range(2, min(most, len(one.lines)) + 1):
                        if two.closed:
                            yield f"{parts} equal parts, opened", cut(one, parts) | cut(two, 1)


def edges_in_plane(mesh: QuadMesh, symmetry: Symmetry) -> Int[np.ndarray, " some"]:
    """Return the indices of the inner edges in the plane of a mirror symmetry; empty if it is a rotation."""
    if not symmetry.is_mirror:
        return np.zeros(0, dtype=np.int64)
    still = symmetry.vertices == np.arange(len(mesh.vertices))
    return np.flatnonzero(still[mesh.edges].all(axis=1) & ~mesh.border)


def cuts_along_folds(mesh: QuadMesh) -> Iterator[tuple[str, Bool[np.ndarray, " edges"]]]:
    """Yield one set of cuts, name and (E,) bool: all folds that are sharper than spirals can bend, if there are any."""
    polygons = PolygonMesh.from_quads(mesh)
    cut = (fold_angles(polygons, sides_of(polygons)) > SHARP) & ~mesh.border
    if cut.any():
        yield "along its folds", cut


def cuts_in_planes(mesh: QuadMesh, symmetries: Sequence[Symmetry]) -> Iterator[tuple[str, Bool[np.ndarray, " edges"]]]:
    """Yield the cuts along each mirror plane, and along all mirror planes together: name and (E,) bool."""
    found = []
    for symmetry in symmetries:
        edges = edges_in_plane(mesh, symmetry)
        if len(edges):
            cut = np.zeros(len(mesh.edges), dtype=bool)
            cut[edges] = True
            found.append(cut)
            yield "along a mirror plane", cut
    if len(found) > 1:
        yield "along all mirror planes", np.any(found, axis=0)


def drop_symmetric_images(
    sketches: Iterable[tuple[str, Bool[np.ndarray, " edges"]]], symmetries: Sequence[Symmetry]
) -> Iterator[tuple[str, Bool[np.ndarray, " edges"]]]:
    """Yield the sets of cuts that are neither equal to an earlier one nor its image under a symmetry.

    Parameters
    ----------
    sketches : name and cut edges, (E,) bool, of every set
    symmetries : symmetries of the mesh
    """
    seen = set[bytes]()
    for name, cut in sketches:
        if cut.tobytes() not in seen:
            images = (np.isin(np.arange(len(cut)), symmetry.edges[cut]) for symmetry in symmetries)
            seen.update(image.tobytes() for image in (cut, *images))
            yield name, cut


def symmetric_variants(
    cut: Bool[np.ndarray, " edges"], mesh: QuadMesh, symmetries: Sequence[Symmetry]
) -> Iterator[tuple[str, Bool[np.ndarray, " edges"]]]:
    """Yield symmetric layouts made from the cuts of a layout: name and (E,) bool.

    Either the images of all cuts are added, or the cuts on one side of a mirror plane are mirrored to the other side.
    At most ``MAX_SYMMETRIC`` of each kind are yielded.

    Parameters
    ----------
    cut : (E,) whether an edge is cut in the layout
    mesh : quad mesh
    symmetries : symmetries of the mesh
    """
    ways: dict[str, dict[bytes, np.ndarray]] = {"as it was, with its images": {}, "one half, mirrored": {}}
    images, halves = ways.values()
    for symmetry in symmetries:
        found = _open_with_images(cut, mesh, symmetry)
        images[found.tobytes()] = found
        if symmetry.is_mirror:
            middle = mesh.vertices[mesh.edges].mean(axis=1)
            # the vector from an edge's mirror image to the edge tells on which side of the plane the edge lies
            side = (middle - middle[symmetry.edges]) @ symmetry.normal
            for way in (1.0, -1.0):
                found = _open_with_images(np.where(way * side >= 0.0, cut, cut[symmetry.edges]), mesh, symmetry)
                halves[found.tobytes()] = found
    for name, layouts in ways.items():
        sound = [one for one in layouts.values() if one.any() and (one != cut).any() and preserved_by(symmetries, one)]
        yield from ((name, one) for one in sorted(sound, key=lambda one: int(one.sum()))[:MAX_SYMMETRIC])


def open_symmetrically(
    cut: Bool[np.ndarray, " edges"], mesh: QuadMesh, symmetries: Sequence[Symmetry]
) -> Bool[np.ndarray, " edges"] | None:
    """Add the fewest symmetric cuts that open all patches which are not disks (tubes, rings).

    Parameters
    ----------
    cut : (E,) whether an edge is cut
    mesh : quad mesh
    symmetries : symmetries of the mesh

    Returns
    -------
    (E,) all cuts; None if the cuts are not symmetric, if ``make_disks`` keeps a symmetry anyway, or if no symmetric
    cuts are found
    """
    kept = preserved_by(symmetries, cut)
    if not kept or preserved_by(kept, make_disks(PatchLayout(mesh, cut)).cut):
        return None
    sound = [one for one in (_open_with_images(cut, mesh, symmetry) for symmetry in kept) if preserved_by(kept, one)]
    return min(sound, key=lambda one: int(one.sum()), default=None)


def _open_with_images(cut: np.ndarray, mesh: QuadMesh, symmetry: Symmetry) -> np.ndarray:
    """Add images of the cuts under a symmetry, and cuts that open patches which are not disks, until both hold.

    After ``MAX_OPENING_ROUNDS`` rounds the present cuts are returned, which may lack images.
    """
    for _ in range(MAX_OPENING_ROUNDS):
        cut = symmetric_closure(cut, [symmetry])
        opened = make_disks(PatchLayout(mesh, cut)).cut & ~mesh.border
        if (opened == cut).all():
            break
        cut = opened
    return cut
