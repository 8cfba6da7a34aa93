"""Files that are broken, or mean harm, end in one clear error that names the line."""

from __future__ import annotations

import pytest

import varint as vi
import varint.multibody as mb
from varint.multibody import elements

LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>{}</joint>'
TWO = LINK.format("a") + LINK.format("b")


def robot(*parts: str) -> str:
    return "<robot>\n" + "\n".join(parts) + "\n</robot>"


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("<robot><link></robot>", "text:1: no well-formed XML"),
        ("<robot/>", "has no links"),
        ("<scene/>", "begins with <robot>"),
        ("<!DOCTYPE r [<!ENTITY a 'b'>]><robot/>", "document type"),
        ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot/>', "document type"),
        ("<robot>&undefined;</robot>", "no well-formed XML"),
        (robot('<link name="a"/>', '<link name="a"/>'), "text:3: .*line 2 already"),
        (robot("<link/>"), "needs the attribute name"),
        (robot(TWO), "2 links that no joint leads to"),
        (robot(TWO, JOINT.format("j", "hinge", "a", "b", "")), "type='hinge' is none of"),
        (robot(TWO, JOINT.format("j", "fixed", "a", "c", "")), "no link 'c'"),
        (robot(TWO, '<joint name="j" type="fixed"/>'), "needs a <parent"),
        (
            robot(
                TWO,
                JOINT.format("j", "fixed", "a", "b", ""),
                JOINT.format("k", "fixed", "b", "a", ""),
            ),
            "is a ring",
        ),
        (
            robot(
                TWO,
                JOINT.format("j", "fixed", "a", "b", ""),
                JOINT.format("k", "fixed", "a", "b", ""),
            ),
            "no closed loops",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<axis xyz="0 0 0"/>')),
            "axis is zero",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<axis xyz="0 0"/>')),
            "has 2 numbers; give 3",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<origin rpy="0 nan 0"/>')),
            "'nan' is no finite number",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<limit lower="2" upper="1"/>')),
            "excludes every motion",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<dynamics damping="-1"/>')),
            "damping and friction",
        ),
        (
            robot(TWO, JOINT.format("j", "revolute", "a", "b", '<mimic joint="x"/>')),
            "text:3: <mimic>: unknown joint 'x'",
        ),
        (robot(LINK.format("a").replace('"1"', '"-1"', 1)), "the mass -1 is negative"),
        (robot(LINK.format("a").replace('izz="1"', 'izz="-1"')), "negative principal moment"),
        (robot(LINK.format("a").replace('ixy="0" ', "")), "needs the attribute ixy"),
        (robot(TWO + "<joint>" * 500 + "</joint>" * 500), "within one another"),
    ],
)
def test_a_broken_urdf_is_refused(text, complaint):
    with pytest.raises(vi.InputError, match=complaint):
        mb.from_urdf(text).system()


def mujoco(inner: str, outer: str = "") -> str:
    return f"<mujoco>\n<worldbody>\n{inner}\n</worldbody>\n{outer}\n</mujoco>"


BODY = '<body name="b"><joint name="j"/><geom size="0.1"/>{}</body>'


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("<robot/>", "begins with <mujoco>"),
        ("<!DOCTYPE m []><mujoco/>", "document type"),
        (mujoco(BODY.format("<joint/>" * 2 + "<wheel/>")), "<wheel> is not read"),
        (mujoco(BODY.format("") + BODY.format("")), "text:3: .*two bodies 'b'"),
        (mujoco(BODY.format("").replace('size="0.1"', "")), "needs 1 positive sizes"),
        (mujoco(BODY.format("").replace("0.1", "1e300")), "positive sizes below 1e\\+50"),
        (mujoco(BODY.format('<geom class="c" size="1"/>')), "unknown class 'c'"),
        (mujoco(BODY.format('<geom type="cone" size="1"/>')), "'cone' is none of"),
        (mujoco(BODY.format('<geom type="mesh" mesh="m"/>')), "unknown mesh 'm'"),
        (
            mujoco(BODY.format('<geom size="1" quat="1 0 0 0" euler="0 0 0"/>')),
            "gives its orientation 2 times",
        ),
        (mujoco(BODY.format('<geom size="1" quat="0 0 0 0"/>')), "gives no direction"),
        (mujoco(BODY.format('<geom size="1" mass="-1"/>')), "negative mass"),
        (mujoco(BODY.format("<freejoint/>")), "only one"),
        (mujoco('<body mocap="true"/>'), "motion capture"),
        (mujoco('<body gravcomp="1"/>'), "gravcomp"),
        (mujoco(BODY.format(""), "<deformable/>"), "<deformable> is not read"),
        (
            mujoco(BODY.format(""), '<tendon><fixed stiffness="3"/></tendon>'),
            "<tendon> is not read",
        ),
        (mujoco(BODY.format(""), '<actuator><muscle joint="j"/></actuator>'), "state of its own"),
        (mujoco(BODY.format(""), '<actuator><motor joint="x"/></actuator>'), "no joint 'x'"),
        (mujoco(BODY.format(""), '<actuator><motor joint="j" delay="1"/></actuator>'), "delay"),
        (
            mujoco(BODY.format(""), '<equality><tendon tendon1="t"/></equality>'),
            "none of the equalities",
        ),
        (
            mujoco(BODY.format(""), '<equality><connect body1="x" anchor="0 0 0"/></equality>'),
            "no bodies",
        ),
        (mujoco(BODY.format(""), '<include file="x.xml"/>'), "needs a folder"),
        (mujoco(BODY.format(""), '<compiler angle="gon"/>'), "'gon' is none of"),
        (mujoco(BODY.format('<joint springdamper="1 1"/>')), "springdamper is not read"),
        (mujoco(BODY.format('<joint damping="1 2"/>')), "is not linear"),
    ],
)
def test_a_broken_mjcf_is_refused(text, complaint):
    with pytest.raises(vi.InputError, match=complaint):
        mb.from_mjcf(text)


def test_a_laughing_billion_costs_nothing():
    lines = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(30))
    with pytest.raises(vi.InputError, match="document type"):
        mb.from_mjcf(f'<!DOCTYPE m [<!ENTITY a0 "ha">{lines}]><mujoco>&a30;</mujoco>')


def test_included_files_and_meshes_stay_in_the_folder(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "secret.xml"
    (inside / "parts").mkdir(parents=True)
    outside.write_text("<mujoco/>")
    part = inside / "parts" / "part.xml"
    part.write_text(mujoco(BODY.format("")))
    main = inside / "main.xml"
    main.write_text('<mujoco>\n<include file="parts/part.xml"/>\n</mujoco>')
    assert mb.from_mjcf(main).system().names == ("j",)
    assert mb.from_mjcf(main.read_text(), folder=inside).system().names == ("j",)
    for name in ("../secret.xml", str(outside), "https://example.org/part.xml", "parts/none.xml"):
        main.write_text(f'<mujoco>\n<include file="{name}"/>\n</mujoco>')
        with pytest.raises(vi.InputError, match=r"main.xml:2: <include>: "):
            mb.from_mjcf(main)
    link = inside / "link.xml"
    link.symlink_to(outside)
    main.write_text('<mujoco><include file="link.xml"/></mujoco>')
    with pytest.raises(vi.InputError, match="leads out of the folder"):
        mb.from_mjcf(main)
    part.write_text('<mujoco><include file="parts/part.xml"/></mujoco>')
    main.write_text('<mujoco><include file="parts/part.xml"/></mujoco>')
    with pytest.raises(vi.InputError, match="included twice"):
        mb.from_mjcf(main)


def test_a_mesh_outside_the_folder_is_not_drawn_and_that_is_said(tmp_path):
    (tmp_path / "secret.stl").write_text("solid")
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    for name in ("../secret.stl", "package://other/secret.stl", "http://example.org/a.stl"):
        file = tmp_path / "robot" / "r.urdf"
        file.parent.mkdir(exist_ok=True)
        link = LINK.format("b").replace("</link>", mesh.format(name))
        file.write_text(
            robot(LINK.format("a"), link, JOINT.format("j", "continuous", "a", "b", ""))
        )
        with pytest.warns(UserWarning, match=r"not drawn.* on line 3"):
            model = mb.from_urdf(file)
        assert model.bodies["b"].visuals == ()


def test_what_is_no_file_is_refused(tmp_path, monkeypatch):
    for source in (tmp_path / "none.urdf", "none.urdf", tmp_path, 3, None):
        with pytest.raises(vi.InputError, match=r"no file|give a path"):
            mb.from_urdf(source)
    with pytest.raises(vi.InputError, match="is no folder"):
        mb.from_urdf(robot(LINK.format("a")), folder=tmp_path / "none")
    large = tmp_path / "large.urdf"
    large.write_text(robot(LINK.format("a")))
    monkeypatch.setattr(elements, "MOST_BYTES", 100)
    with pytest.raises(vi.InputError, match="the limit is 100"):
        mb.from_urdf(large)
    (tmp_path / "latin.urdf").write_bytes(b'<?xml version="1.0" encoding="utf-9"?><robot/>')
    with pytest.raises(vi.InputError, match="encoding"):
        mb.from_urdf(tmp_path / "latin.urdf")
