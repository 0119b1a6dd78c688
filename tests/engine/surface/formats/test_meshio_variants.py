"""The same two quads in every dress that other programs write and read: all must give the same mesh."""

from __future__ import annotations

import contextlib
import struct

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface.checking import check
from flexmaps.engine.surface.formats import meshio

VERTICES = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0.5)]
FACES = [(0, 1, 4, 3), (1, 2, 5, 4)]
ROWS = [" ".join(map(str, v)) for v in VERTICES]
TRIANGLES = [t for f in FACES for t in ((f[0], f[1], f[2]), (f[0], f[2], f[3]))]


def _off(head="OFF\n6 2 0\n", more="", faces="4 0 1 4 3\n4 1 2 5 4\n", end=""):
    return head + "".join(f"{row}{more}\n" for row in ROWS) + faces + end


OFF = {
    "plain": _off(),
    "no number of edges": _off("OFF\n6 2\n"),
    "counts beside the keyword": _off("OFF 6 2 0\n"),
    "counts glued to the keyword": _off("OFF6 2 0\n"),
    "a line for every count": _off("OFF\n6\n2\n0\n"),
    "no keyword": _off("6 2 0\n"),
    "small letters": _off("off\n6 2 0\n"),
    "colours of vertices": _off("COFF\n6 2 0\n", " 255 0 0 255"),
    "three colours": _off("COFF\n6 2 0\n", " 0.1 0.2 0.3"),
    "normals": _off("NOFF\n6 2 0\n", " 0 0 1"),
    "everything": _off("STCNOFF\n6 2 0\n", " 0 0 1 1 0 0 1 0.5 0.5"),
    "index of a colour": _off(faces="4 0 1 4 3 7\n4 1 2 5 4 7\n"),
    "colours of faces": _off(faces="4 0 1 4 3 255 0 0\n4 1 2 5 4 0.5 0 0 1\n"),
    "a colour on one face": _off(faces="4 0 1 4 3 255 0 0\n4 1 2 5 4\n"),
    "comments everywhere": "# a\nOFF # b\n# c\n6 2 0 # d\n" + "".join(f"{r} # e\n#\n" for r in ROWS) + "4 0 1 4 3#\n\n4 1 2 5 4",
    "faces over several lines": _off(faces="4 0 1\n4\n3\n4 1 2 5\n4\n"),
    "a line for the size": _off(faces="4\n0 1 4 3\n4\n1 2 5 4\n"),
    "vertices on one line": "OFF\n6 2 0\n" + " ".join(ROWS) + "\n4 0 1 4 3\n4 1 2 5 4\n",
    "vertices with normals on one line": "NOFF\n6 2 0\n" + " 0 0 1 ".join(ROWS) + " 0 0 1\n4 0 1 4 3\n4 1 2 5 4\n",
    "vertices with colours on one line": "COFF\n6 2 0\n" + " 9 8 7 6 ".join(ROWS) + " 9 8 7 6\n4 0 1 4 3\n4 1 2 5 4\n",
    "faces on one line": _off(faces="4 0 1 4 3 4 1 2 5 4\n"),
    "one line": _off().replace("\n", " "),
    "a line for every word": _off().replace(" ", "\n"),
    "byte-order mark": "\ufeff" + _off(),
    "carriage returns": _off().replace("\n", "\r\n"),
    "old Mac": _off().replace("\n", "\r"),
    "tabs and empty lines": _off().replace(" ", "\t").replace("\n", "\n\n"),
    "no last line end": _off().rstrip(),
    "exponents and signs": _off(faces="+4 0 1 4 3\n4 1 2 5 4\n").replace("0.5", "+5.0E-01"),
}  # fmt: skip

V, F = "".join(f"v {row}\n" for row in ROWS), "f 1 2 5 4\nf 2 3 6 5\n"
OBJ = {
    "plain": V + F,
    "counted backwards": V + "f -6 -5 -2 -3\nf -5 -4 -1 -2\n",
    "both ways": V + "f 1 2 -2 4\nf 2 -4 6 5\n",
    "texture and normals": "vt 0 0\nvn 0 0 1\n" + V + "f 1/1 2/1 5/1 4/1\nf 2//1 3//1 6/1/1 5//1\n",
    "empty slashes": V + "f 1// 2// 5// 4//\nf 2/ 3/ 6/ 5/\n",
    "continued lines": V.replace("v 0 0 0\n", "v 0 \\\n0 0\n") + "f 1 2 \\\n5 4\nf 2 \\\n3 6 \\\n 5\n",
    "groups": "o a\ng x y\ns off\nusemtl q\nmtllib z.mtl\n" + V + F,
    "colours and weights": V.replace("\n", " .1 .2 .3\n") + F,
    "lines, points, curves": V + "l 1 2\np 1\ncurv 0 1 1 2\ncstype bezier\n" + F,
    "faces first": F + V,
    "indented": "  " + (V + F).replace("\n", "\n\t"),
    "comments": "# a\n" + (V + F).replace("\n", " # b\n") + "#",
    "latin-1 in a comment": b"# \xe9\xff\n" + (V + F).encode(),
    "byte-order mark": "\ufeff" + V + F,
    "carriage returns": (V + F).replace("\n", "\r\n"),
    "old Mac": (V + F).replace("\n", "\r"),
    "words at the end": V + F + "that was all\n",
}


def _ply(order="", end="\n", comments=(), length="uchar", index="int", real="float"):
    """``order``: "" for text, "<" and ">" for binary."""
    codes = {"uchar": "B", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d", "uint8": "B"}
    format = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = ["ply", f"format {format} 1.0", *comments, "element vertex 6", *(f"property {real} {a}" for a in "xyz")]
    head += ["element face 2", f"property list {length} {index} vertex_indices", "end_header"]
    data = (end.join(head) + end).encode()
    if not order:
        return data + end.join([*ROWS, "4 0 1 4 3", "4 1 2 5 4", ""]).encode()
    data += b"".join(struct.pack(f"{order}3{codes[real]}", *v) for v in VERTICES)
    return data + b"".join(struct.pack(f"{order}{codes[length]}4{codes[index]}", 4, *f) for f in FACES)


PLY = {
    f"{name}, {kind}": _ply(order, **options)
    for order, kind in (("", "text"), ("<", "little-endian"), (">", "big-endian"))
    for name, options in {
        "plain": {},
        "carriage returns": {"end": "\r\n"},
        "a comment with end_header": {"comments": ["comment by end_header", "obj_info end_header", "comment end_header "]},
        "other types": {"length": "int", "index": "uint", "real": "double"},
        "short types": {"length": "uint8", "index": "ushort"},
    }.items()
} | {
    "old Mac": _ply(end="\r"),
    "byte-order mark": b"\xef\xbb\xbf" + _ply(),
    "vertices over lines": _ply().replace(b"0 0 0\n1 0 0\n", b"0 0 0 1 0\n0\n"),
    "faces over lines": _ply().replace(b"4 0 1 4 3\n", b"4 0 1\n4 3\n"),
    "faces first, other order, more elements": (
        "ply\nformat ascii 1.0\nelement face 2\nproperty uchar red\nproperty list uchar int vertex_indices\n"
        "property list uchar float texcoord\nelement vertex 6\nproperty uchar red\nproperty float z\nproperty float y\n"
        "property float x\nelement tristrips 1\nproperty list int int vertex_indices\nelement edge 1\n"
        "property int vertex1\nproperty int vertex2\nend_header\n9 4 0 1 4 3 2 0 1\n9 4 1 2 5 4 0\n"
        + "".join(f"7 {z} {y} {x}\n" for x, y, z in VERTICES) + "5 0 1 2 -1 3\n0 1\n"
    ),
}  # fmt: skip


def _stl(head="solid x", end="endsolid x\n", line="\n", triangles=TRIANGLES):
    corner = [line.join(f"vertex {ROWS[i]}" for i in t) for t in triangles]
    facets = [line.join(["facet normal 0 0 1", "outer loop", c, "endloop", "endfacet", ""]) for c in corner]
    return head + line + "".join(facets) + end


def _binary_stl(head=b"", tail=b"", more=0):
    facets = [struct.pack("<12fH", 0, 0, 1, *(x for i in t for x in VERTICES[i]), more) for t in TRIANGLES]
    return head.ljust(80) + struct.pack("<I", len(TRIANGLES)) + b"".join(facets) + tail


STL = {
    "text": _stl(),
    "capitals": _stl().upper(),
    "no name": _stl("solid", "endsolid"),
    "a name of its own words": _stl("solid vertex facet normal endfacet"),
    "latin-1 in the name": _stl("solid \xe9").encode("latin-1"),
    "two solids": _stl(triangles=TRIANGLES[:2]) + _stl(triangles=TRIANGLES[2:]),
    "words at the end": _stl() + "\nthat was all\n",
    "one line": _stl(line=" "),
    "a line for every word": _stl().replace("\n ", " ").replace(" ", "\n"),
    "byte-order mark": "\ufeff" + _stl(),
    "carriage returns": _stl(line="\r\n"),
    "old Mac": _stl(line="\r"),
    "binary": _binary_stl(),
    "binary that begins with solid": _binary_stl(b"solid thing\nfacet normal"),
    "binary with attributes": _binary_stl(more=77),
    "binary filled up": _binary_stl(tail=b"\0" * 20),
}
CASES = [(suffix, name) for suffix, cases in (("off", OFF), ("obj", OBJ), ("ply", PLY), ("stl", STL)) for name in cases]


def _content(suffix, name):
    content = {"off": OFF, "obj": OBJ, "ply": PLY, "stl": STL}[suffix][name]
    return content if isinstance(content, bytes) else content.encode()


def _read(suffix, content):
    return meshio.parse_mesh(content if isinstance(content, bytes) else content.encode(), f"x.{suffix}")


@pytest.mark.parametrize(("suffix", "name"), CASES)
def test_every_dress_is_the_same_mesh(suffix, name):
    mesh = _read(suffix, _content(suffix, name))
    faces = TRIANGLES if suffix == "stl" else FACES
    assert mesh.sizes.tolist() == [len(f) for f in faces]
    wanted = np.array([VERTICES[i] for f in faces for i in f], float)
    np.testing.assert_array_equal(mesh.vertices[mesh.corners], wanted)
    assert mesh.left_out == ()


@pytest.mark.parametrize("name", ["plain", "colours of vertices", "faces over several lines", "a line for the size"])
def test_off_as_libigl_reads_it(tmp_path, name):
    igl = pytest.importorskip("igl")
    path = tmp_path / "x.off"
    path.write_bytes(_content("off", name))
    vertices, triangles = igl.read_triangle_mesh(str(path))
    mesh = meshio.read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    fans = [(f[0], f[i], f[i + 1]) for f in mesh.corners.reshape(-1, 4).tolist() for i in (1, 2)]
    assert sorted(map(sorted, fans)) == sorted(map(sorted, np.asarray(triangles).tolist()))


EXTRA = {
    "off-double": _off("OFF\n6 3 0\n", end="4 1 2 5 4\n"),
    "obj-double turned over": V + F + "f 5 6 3 2\n",
    "obj-two corners": V + F + "f 1 2\n",
    "off-two corners": _off("OFF\n6 3 0\n", end="2 0 1\n"),
    "off-lines at the end": _off(end="2 0 1\nthat was all\n"),
    "ply-bytes at the end": _ply("<") + b"garbage",
    "ply-lines at the end": _ply() + b"garbage\n",
}


@pytest.mark.parametrize("case", EXTRA)
def test_what_is_left_out_is_said(case):
    mesh = _read(case[:3], EXTRA[case])
    assert mesh.corners.reshape(-1, 4).tolist() == [list(f) for f in FACES]
    assert len(mesh.left_out) == 1
    assert "left out" in mesh.left_out[0]
    scaled = check.scale_to_metres(mesh, edge=0.02)
    assert [f.message for f in check.findings(scaled) if f.code == "left-out"] == [mesh.left_out[0]]
    assert len(check.as_quad_mesh(scaled).quads) == 2


def test_doubled_triangles_and_a_missing_end_of_stl():
    mesh = _read("stl", _stl(triangles=[*TRIANGLES, TRIANGLES[1][::-1]], end=""))
    assert len(mesh.sizes) == len(TRIANGLES)
    assert len(mesh.left_out) == 2


def test_stray_vertices_may_be_anywhere():
    mesh = _read("obj", V + "v nan inf 0\nv 9 9 9\n" + F)
    found = check.findings(check.scale_to_metres(mesh, edge=0.02))
    assert [f.code for f in found] == ["loose-vertices"]
    assert len(check.as_quad_mesh(mesh).vertices) == 6


def test_faces_that_the_head_does_not_promise_are_not_lost():
    with pytest.raises(FlexMapsError, match="line 10: more lines than the 6 vertices and 1 faces"):
        _read("off", _off("OFF\n6 1 0\n"))


def test_blender_agrees_about_doubles(tmp_path):
    bpy = pytest.importorskip("bpy")
    path = tmp_path / "x.obj"
    path.write_text(EXTRA["obj-double turned over"])
    before = set(bpy.data.objects)
    with contextlib.redirect_stdout(None):
        bpy.ops.wm.obj_import(filepath=str(path))
    (made,) = set(bpy.data.objects) - before
    try:
        assert len(made.data.polygons) == len(meshio.read_mesh(path).sizes) == 2
    finally:
        bpy.data.objects.remove(made)


def test_faces_over_several_lines_in_a_real_file(shared_meshes):
    path = shared_meshes / "foreign" / "inspired_mesh_quads_Smooth.off"
    if not path.is_file():
        pytest.skip("that mesh is not there")
    mesh = meshio.read_mesh(path)
    assert mesh.sizes.tolist() == [4] * 1838
    assert len(mesh.vertices) == 1963
