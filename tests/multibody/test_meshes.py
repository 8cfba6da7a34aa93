"""Surfaces from files: what they enclose weighs what the solid does; open ones weigh nothing."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import varint as vi
import varint.multibody as mb
from varint.drawing.surfaces import Surface, primitive
from varint.multibody import mesh

BOX = (0.1, 0.2, 0.3)
MJCF = """<mujoco><compiler angle="radian"/><asset><mesh name="m" file="{file}" {more}/></asset>
<worldbody><body name="b"><joint/><geom type="{kind}" {shape} pos="0.1 0.2 0.3" euler="0.3 0.2 0.1"
density="700"/></body></worldbody></mujoco>"""


def write_stl(path: Path, surface: Surface) -> None:
    """An STL file in text."""
    lines = ["solid s"]
    for face in surface.faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(map(repr, map(float, surface.vertices[k]))) for k in face]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid s"]))


@pytest.mark.parametrize("more", ["", 'scale="2 3 -0.5"', 'refpos="0.1 0 0.2" refquat="1 0 1 0"'])
def test_a_box_from_a_file_weighs_what_a_box_weighs(tmp_path, more):
    pytest.importorskip("trimesh")
    write_stl(tmp_path / "box.stl", primitive("box", BOX))
    text = MJCF.format(file="box.stl", more=more, kind="mesh", shape='mesh="m"')
    body = mb.from_mjcf(text, folder=tmp_path).bodies["b"]
    size = np.array(BOX) * ([2, 3, 0.5] if "scale" in more else 1)
    solid = MJCF.format(
        file="", more="", kind="box", shape=f'size="{" ".join(map(str, size))}"'
    ).replace('<mesh name="m" file="" />', "")
    expected = mb.from_mjcf(solid).bodies["b"]
    assert body.mass == pytest.approx(expected.mass, rel=1e-6)  # STL keeps single precision
    if not more.startswith("ref"):
        assert body.com == pytest.approx(expected.com, rel=1e-6)
        assert body.inertia == pytest.approx(expected.inertia, rel=1e-5, abs=1e-6)
    else:  # seen from (0.1, 0, 0.2), turned by a right angle about y
        turn = mb.axis_rotation([0, 1, 0], np.pi / 2)
        angles = (
            mb.axis_rotation(axis, x) for axis, x in zip(np.eye(3), (0.3, 0.2, 0.1), strict=True)
        )
        own = np.linalg.multi_dot([*angles])
        shift = own @ turn.T @ [-0.1, 0, -0.2]
        assert body.com == pytest.approx(np.array([0.1, 0.2, 0.3]) + shift, rel=1e-6)
        moments = np.linalg.eigvalsh(body.inertia)
        assert moments == pytest.approx(np.linalg.eigvalsh(expected.inertia), rel=1e-5)


def test_a_surface_with_a_hole_encloses_nothing(tmp_path):
    pytest.importorskip("trimesh")
    box = primitive("box", BOX)
    write_stl(tmp_path / "open.stl", Surface(box.vertices, box.faces[1:]))
    text = MJCF.format(file="open.stl", more="", kind="mesh", shape='mesh="m"')
    with pytest.raises(vi.InputError, match="no closed surface"):
        mb.from_mjcf(text, folder=tmp_path)
    (tmp_path / "open.stl").write_text("solid nothing")
    with pytest.raises(vi.InputError, match=r"open\.stl (cannot be read|holds no surface)"):
        mb.from_mjcf(text, folder=tmp_path)


def test_without_trimesh_a_mass_from_a_mesh_is_refused(tmp_path, monkeypatch):
    write_stl(tmp_path / "box.stl", primitive("box", BOX))
    found = importlib.util.find_spec
    monkeypatch.setattr(
        mesh.importlib.util, "find_spec", lambda name: None if name == "trimesh" else found(name)
    )
    text = MJCF.format(file="box.stl", more="", kind="mesh", shape='mesh="m"')
    with pytest.raises(vi.InputError, match=r"needs trimesh; pip install"):
        mb.from_mjcf(text, folder=tmp_path)
    # with a mass of its own it is only drawn
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint/>'
    text = text.replace("<joint/>", inertial).replace('density="700"', 'mass="0"')
    assert mb.from_mjcf(text, folder=tmp_path).bodies["b"].mass == 1
    for name in ("box.dae", "../box.stl"):
        with pytest.raises(vi.InputError):
            mb.from_mjcf(text.replace("box.stl", name), folder=tmp_path)
