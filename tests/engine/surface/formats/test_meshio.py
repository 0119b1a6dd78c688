"""Reading mesh files: what good files hold, and that bad ones are refused by name."""

from __future__ import annotations

import contextlib
import re
import struct

import numpy as np
import pytest
from flexmaps.engine.errors import FlexMapsError
from flexmaps.engine.surface import shapes
from flexmaps.engine.surface.formats import meshio
from flexmaps.engine.surface.mesh import PolygonMesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

FORMATS = (".obj", ".off", ".ply", ".stl")
BASIC_OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def save(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(tmp_path, name, content) -> PolygonMesh:
    return meshio.read_mesh(save(tmp_path, name, content))


def refusal(tmp_path, name, content) -> str:
    path = save(tmp_path, name, content)
    with pytest.raises(FlexMapsError) as caught:
        meshio.read_mesh(path)
    text = str(caught.value)
    assert name in text
    assert "\n" not in text
    return text


def ply(order: str, vertices, faces, extra: bool = False) -> bytes:
    """A PLY file written by hand; ``order`` is "", "<" or ">"."""
    format = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = ["ply", f"format {format} 1.0", "comment by hand", f"element vertex {len(vertices)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += ["property uchar red"] if extra else []
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord", "element edge 1", "property int vertex1"] if extra else []
    data = ("\n".join([*head, "end_header"]) + "\n").encode()
    for v in vertices:
        if order:
            data += struct.pack(order + "3f", *v) + (b"\x07" if extra else b"")
        else:
            data += (" ".join(map(repr, map(float, v))) + (" 7" if extra else "") + "\n").encode()
    for f in faces:
        if order:
            data += struct.pack(f"{order}B{len(f)}i", len(f), *f) + (
                struct.pack(order + "B2f", 2, 0, 1) if extra else b""
            )
        else:
            data += (f"{len(f)} " + " ".join(map(str, f)) + (" 2 0 1" if extra else "") + "\n").encode()
    if extra:
        data += struct.pack(order + "i", 3) if order else b"3\n"
    return data


# -- what good files hold --------------------------------------------------------------------------------------------


def test_obj_with_everything(tmp_path):
    mesh = read(
        tmp_path,
        "all.OBJ",
        "\ufeff# head\r\nmtllib x.mtl\r\no thing\r\ng group one\r\nv 0 0 0 1 0.5 0.5 0.5\r\nv 1 0 0 # here\r\nvt 0 0\r\nvn 0 0 1\r\n"
        "v 1 \\\r\n 1 0\r\nv 0 1 0\r\ns 1\r\nusemtl m\r\nf 1/1/1 2//1 3/1 4\r\nl 1 2\r\nv 2 0 0\r\nf -1 -4 \\\r\n -3\r\nf 5 2 3 4 1\r\n",
    )
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]]
    assert mesh.sizes.tolist() == [4, 3, 5]
    assert mesh.corners.tolist() == [0, 1, 2, 3, 4, 1, 2, 4, 1, 2, 3, 0]


def test_obj_old_mac_line_ends_and_forward_references(tmp_path):
    mesh = read(tmp_path, "mac.obj", "f 1 2 3\rv 0 0 0\rv 1 0 0\rv 0 1 0\r")
    assert mesh.corners.tolist() == [0, 1, 2]


@pytest.mark.parametrize("head", ["OFF\n3 1 0\n", "OFF 3 1 0\n", "COFF\n# c\n3 1\n", "3 1 0\n", "NOFF\n\n3 1 0 # x\n"])
def test_off_heads(tmp_path, head):
    mesh = read(tmp_path, "x.off", head + "0 0 0 255 0 0\n1 0 0\n # comment\n0 1 0\n3 0 1 2 0.5 0.5 0.5\n")
    assert mesh.vertices.shape == (3, 3)
    assert mesh.corners.tolist() == [0, 1, 2]


@pytest.mark.parametrize("order", ["", "<", ">"])
@pytest.mark.parametrize("extra", [False, True])
def test_ply_mixed_faces(tmp_path, order, extra):
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.25], [2, 0, 0]]
    faces = [[0, 1, 2, 3], [1, 4, 2], [0, 1, 4, 2, 3], [1, 4, 3]]
    mesh = read(tmp_path, "m.ply", ply(order, vertices, faces, extra))
    np.testing.assert_array_equal(mesh.vertices, vertices)
    assert mesh.sizes.tolist() == [4, 3, 5, 3]
    assert mesh.corners.tolist() == [v for f in faces for v in f]


def test_stl_merges_equal_corners_only(tmp_path):
    text = "solid s\n"
    for triangle in (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)],
        [(1, 0, 0), (1, 1, 0), (0, 1, 0)],
        [(-0.0, 0, 0), (0, 1, 0), (1e-7, 0, 1)],
    ):
        text += "facet normal 0 0 1\n outer loop\n"
        text += "".join(f"  vertex {x} {y} {z}\n" for x, y, z in triangle) + " endloop\nendfacet\n"
    mesh = read(tmp_path, "t.stl", text + "endsolid s\n")
    assert mesh.corners.tolist() == [0, 1, 2, 1, 3, 2, 0, 2, 4]
    assert mesh.vertices[4].tolist() == [1e-7, 0, 1]


@pytest.mark.parametrize("kind", ["obj", "off", "ply", "ply-text", "stl", "stl-text"])
def test_against_trimesh(tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    quads = shapes.cubesphere(4)
    triangles = np.concatenate([quads.quads[:, [0, 1, 2]], quads.quads[:, [0, 2, 3]]])
    other = trimesh.Trimesh(quads.vertices, triangles, process=False)
    suffix, _, text = kind.partition("-")
    path = tmp_path / f"m.{suffix}"
    if suffix == "ply":
        other.export(path, encoding="ascii" if text else "binary")
    elif text:
        path.write_text(trimesh.exchange.stl.export_stl_ascii(other))
    else:
        other.export(path)
    mesh = meshio.read_mesh(path)
    assert (mesh.sizes == 3).all()
    assert len(mesh.vertices) == len(quads.vertices)
    np.testing.assert_allclose(
        mesh.vertices[mesh.corners].reshape(-1, 3, 3), other.vertices[other.faces], rtol=0, atol=1e-6
    )


def test_against_blender(tmp_path):
    """Blender writes quads as OBJ, PLY and STL, with its own axes for OBJ: distances must agree."""
    bpy = pytest.importorskip("bpy")
    mesh = shapes.make("torus", 1.0)
    data = bpy.data.meshes.new("torus")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.quads.tolist())
    thing = bpy.data.objects.new("torus", data)
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    writers = {".obj": bpy.ops.wm.obj_export, ".ply": bpy.ops.wm.ply_export, ".stl": bpy.ops.wm.stl_export}
    selected = {".obj": "export_selected_objects", ".ply": "export_selected_objects", ".stl": "export_selected_objects"}
    try:
        for suffix, write in writers.items():
            path = tmp_path / f"torus{suffix}"
            write(filepath=str(path), **{selected[suffix]: True})
            got = meshio.read_mesh(path)
            if suffix == ".stl":
                assert (got.sizes == 3).all()
                assert len(got.sizes) == 2 * len(mesh.quads)
                continue
            assert (got.sizes == 4).all()
            assert len(got.vertices) == len(mesh.vertices)
            diagonal = got.corners.reshape(-1, 4)[:, [0, 2]]
            lengths = np.linalg.norm(got.vertices[diagonal[:, 0]] - got.vertices[diagonal[:, 1]], axis=1)
            wanted = np.linalg.norm(mesh.vertices[mesh.quads[:, 0]] - mesh.vertices[mesh.quads[:, 2]], axis=1)
            np.testing.assert_allclose(np.sort(lengths), np.sort(wanted), atol=1e-4)
    finally:
        bpy.data.objects.remove(thing)
        bpy.data.meshes.remove(data)


def test_shared_meshes(shared_meshes):
    counts = {
        "bunny.obj": 2362,
        "amo_quad.off": 835,
        "moebius_desk.obj": 382,
        "stanford-bunny.obj": 69451,
        "suzanne.obj": 500,
    }
    for name, count in counts.items():
        assert len(meshio.read_mesh(shared_meshes / name).sizes) == count


# -- what bad files are told -----------------------------------------------------------------------------------------


def test_not_a_file(tmp_path):
    with pytest.raises(FlexMapsError, match="does not exist"):
        meshio.read_mesh(tmp_path / "none.obj")
    with pytest.raises(FlexMapsError, match="folder"):
        meshio.read_mesh(tmp_path)
    (tmp_path / "f.obj").mkdir()
    with pytest.raises(FlexMapsError, match="folder"):
        meshio.read_mesh(tmp_path / "f.obj")
    with pytest.raises(FlexMapsError, match=r"\.fbx.*\.obj"):
        meshio.read_mesh(save(tmp_path, "x.fbx", "abc"))
    with pytest.raises(FlexMapsError, match="no suffix"):
        meshio.read_mesh(save(tmp_path, "x", "abc"))
    for name in ("x" * 5000 + ".obj", "a\0b.obj", "\ud800.obj"):
        with pytest.raises(FlexMapsError, match="cannot be read"):
            meshio.read_mesh(tmp_path / name)


def test_no_permission(tmp_path, monkeypatch):
    path = save(tmp_path, "x.obj", BASIC_OBJ)

    def deny(self):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(path), "read_bytes", deny)
    with pytest.raises(FlexMapsError, match=r"x\.obj cannot be read \(Permission denied\)"):
        meshio.read_mesh(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_empty(tmp_path, suffix):
    assert "empty" in refusal(tmp_path, f"e{suffix}", b"")
    assert "empty" in refusal(tmp_path, f"e{suffix}", b" \n\n")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("v 0 0 0\nv 1 0\nf 1 2 1\n", "line 2.*needs 3 numbers"),
        ("v 0 0 zero\nf 1 1 1\n", "line 1.*'0 0 zero'"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1.*not a finite"),
        ("v 0 0 0\nv 1 0 0\nv 0 1e999 0\nf 1 2 3\n", "line 3.*not a finite"),
        (BASIC_OBJ + "f 1 2 5\n", "line 6.*not among the 4"),
        (BASIC_OBJ + "f 1 2 -5\n", "line 6.*not among the 4"),
        (BASIC_OBJ + "f 0 1 2\n", "line 6.*counts vertices from 1"),
        (BASIC_OBJ + "f 1 2 x/1\n", "line 6.*'x'"),
        (BASIC_OBJ + "f 1 2 999999999999999999999999\n", "line 6.*vertex index"),
        ("v 0 0 0\nv 1 0 0\n", "no faces"),
        ("hello\nworld\n", "no vertices and no faces"),
        (b"v 0 0 0\n\0\0\0\0", "not a text file"),
    ],
)
def test_bad_obj(tmp_path, content, told):
    assert re.search(told, refusal(tmp_path, "bad.obj", content))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "cut short.*2 faces"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 2 1\n", "line 7.*more lines"),
        ("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3\n0 1 2\n3\n0 1\n", "line 7.*promises 3"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2_0\n", "line 6.*'2_0'"),
        ("\ufeffOFF\n3 1 0\n0 0 0\n1 0 0\n0 1,5 0\n3 0 1 2\n", "line 5.*'0 1,5 0'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode("utf-16"), "UTF-16"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "line 6.*promises 4"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6.*not among the 3"),
        ("OFF\n3 1 0\n0 0 0\n1 NaN 0\n0 1 0\n3 0 1 2\n", "line 4.*not a finite"),
        ("OFF BINARY\n3 1 0\n", "binary OFF"),
        ("4OFF\n3 1 0\n", "three dimensions"),
        ("OFF\n", "cut short"),
        ("OFF\n-3 1 0\n", "negative"),
        ("hello\n", "is it an OFF"),
        ("# only\n", "only comments"),
    ],
)
def test_bad_off(tmp_path, content, told):
    assert re.search(told, refusal(tmp_path, "bad.off", content))


TRIANGLE = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_bad_ply(tmp_path, order):
    good = ply(order, *TRIANGLE)
    assert "cut short" in refusal(tmp_path, "b.ply", good[: -3 if order else -8])
    assert "not among the 3" in refusal(tmp_path, "b.ply", ply(order, TRIANGLE[0], [[0, 1, 3]]))
    assert "not among the 3" in refusal(tmp_path, "b.ply", ply(order, TRIANGLE[0], [[0, 1, -1]]))
    assert "not a finite" in refusal(
        tmp_path, "b.ply", ply(order, [[0, 0, float("nan")], *TRIANGLE[0][1:]], TRIANGLE[1])
    )
    assert "points or curves" in refusal(tmp_path, "b.ply", ply(order, TRIANGLE[0], [[0, 1]]))
    assert "no faces" in refusal(tmp_path, "b.ply", ply(order, TRIANGLE[0], []))
    assert "cut short" in refusal(tmp_path, "b.ply", good.replace(b"element vertex 3", b"element vertex 3000000000"))


def test_bad_ply_heads(tmp_path):
    good = ply("", *TRIANGLE)
    assert "not a PLY file" in refusal(tmp_path, "b.ply", b"solid")
    assert "end_header" in refusal(tmp_path, "b.ply", good[:40])
    assert "line 2" in refusal(tmp_path, "b.ply", good.replace(b"ascii", b"morse"))
    assert "text or binary" in refusal(tmp_path, "b.ply", good.replace(b"format ascii 1.0\n", b""))
    assert "x, y and z" in refusal(tmp_path, "b.ply", good.replace(b"float z", b"float w"))
    assert "no list" in refusal(tmp_path, "b.ply", good.replace(b"vertex_indices", b"other"))
    assert "face elements" in refusal(tmp_path, "b.ply", good.replace(b"element face", b"element fact"))


def test_bad_stl(tmp_path):
    good = b"x" * 80 + struct.pack("<I", 1) + struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    assert read(tmp_path, "g.stl", good).sizes.tolist() == [3]
    assert "cut short" in refusal(tmp_path, "b.stl", good[:-1])
    assert "neither" in refusal(tmp_path, "b.stl", good[:50])
    assert "no faces" in refusal(tmp_path, "b.stl", b"x" * 80 + struct.pack("<I", 0))
    nan = good[:96] + struct.pack("<f", float("nan")) + good[100:]
    assert "triangle 0" in refusal(tmp_path, "b.stl", nan)
    assert "not whole" in refusal(tmp_path, "b.stl", "solid x\nfacet\nvertex 0 0 0\nvertex 0 0 1\n")
    assert "3 corners" in refusal(tmp_path, "b.stl", "solid x\nfacet\nvertex 0 0 0\nvertex 0 0 1\nendfacet\nendsolid\n")


GOOD = {
    ".obj": BASIC_OBJ.encode() + b"f 1/2 2 3\\\n\n",
    ".off": b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n",
    ".stl": b"x" * 80 + struct.pack("<I", 1) + struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0),
    ".ply": b"",
}


@pytest.mark.filterwarnings("ignore:.*:RuntimeWarning")
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
@pytest.mark.parametrize("suffix", FORMATS)
def test_damaged_files_are_read_or_refused(tmp_path, suffix, data):
    """Whatever happens to a file, the answer is a mesh in range or one FlexMapsError."""
    if suffix == ".ply":
        content = ply(
            data.draw(st.sampled_from(["", "<", ">"])), [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2], [2, 1, 0]], True
        )
    elif suffix == ".stl" and data.draw(st.booleans()):
        content = b"solid\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"
    else:
        content = GOOD[suffix]
    damaged = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(len(damaged) - 1, 0)))
        patch = data.draw(
            st.one_of(st.binary(max_size=6), st.sampled_from([b"-1", b"nan", b"1e400", b" ", b"\n", b"9" * 30, b"#"]))
        )
        damaged[at : at + data.draw(st.integers(0, 5))] = patch
    if data.draw(st.booleans()):
        del damaged[data.draw(st.integers(0, len(damaged))) :]
    path = save(tmp_path, f"d{suffix}", bytes(damaged))
    try:
        mesh = meshio.read_mesh(path)
    except FlexMapsError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(mesh.vertices[mesh.corners]).all()  # a vertex that no face has may be nowhere
    assert mesh.sizes.sum() == len(mesh.corners)
    assert mesh.sizes.min() >= 3
    assert mesh.corners.min() >= 0
    assert mesh.corners.max() < len(mesh.vertices)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200))
@pytest.mark.parametrize("suffix", FORMATS)
def test_noise_is_refused(tmp_path, suffix, content):
    with contextlib.suppress(FlexMapsError):
        meshio.read_mesh(save(tmp_path, f"n{suffix}", content))


@pytest.mark.parametrize(
    ("name", "up", "axis"),
    [
        ("a.obj", None, 1),
        ("A.OBJ", None, 1),
        ("a.off", None, 2),
        ("a.obj", "z", 2),
        ("a.off", "y", 1),
        ("a.off", "x", 0),
    ],
)
def test_the_axis_that_points_up_becomes_z(tmp_path, name, up, axis):
    """A box of 1 x 2 x 3: its sides go round, so that it stays the same way out, and its middle is at the origin."""
    x, y, z = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]])[[0, 1, 2, 3]].T + 5.0
    points, faces = np.column_stack([x, y, z]), [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    head = "" if name.lower().endswith("obj") else "OFF\n4 4 0\n"
    begin, first = ("v ", 1) if not head else ("", 0)
    lines = [begin + " ".join(map(str, p)) for p in points.tolist()]
    lines += [("f " if not head else "3 ") + " ".join(str(k + first) for k in face) for face in faces]
    found, mesh = meshio.read_upright(str(save(tmp_path, name, head + "\n".join(lines) + "\n")), up)
    assert found == name
    size = np.ptp(mesh.vertices, axis=0)
    assert size[2] == axis + 1.0 and size.tolist() == np.roll([1.0, 2.0, 3.0], 2 - axis).tolist()
    volume = np.linalg.det(mesh.vertices[1:] - mesh.vertices[0])
    assert volume == pytest.approx(6.0)
    with pytest.raises(FlexMapsError, match="up is 'w'; give x, y or z"):
        meshio.read_upright(str(tmp_path / name), "w")
