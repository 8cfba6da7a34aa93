"""Robots from URDF: masses, places and forces are Pinocchio's, to round-off."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from machine_terms import off, places_of, terms_of
from references import entries

import varint as vi
import varint.multibody as mb

ARM = Path(__file__).parents[1] / "reference" / "machines" / "arm.urdf"
CLOSE = 1e-12


def arm(**given) -> mb.Model:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*velocity=0.*")
        return mb.from_urdf(ARM, **given)


def test_mass_matrix_bias_and_places_are_those_of_pinocchio():
    """Its coordinates are all joints; what follows is led by the slope of its coupling."""
    model = arm()
    names = model.system().names
    assert names == ("swing", "lift", "reach", "left_finger")
    terms = terms_of(model)
    for state in entries("g")["arm.urdf"]:
        joints, links = state["joints"], state["links"]
        led = np.array([[1.0 * (joint == name) for name in names] for joint in joints])
        led[joints.index("right_finger"), names.index("left_finger")] = -0.8
        q, v = (np.array([state[key][joints.index(name)] for name in names]) for key in "qv")
        found = terms(q, v, np.zeros(0))
        assert off(found.mass_matrix, led.T @ np.array(state["mass_matrix"]) @ led) < CLOSE
        assert off(found.bias, led.T @ np.array(state["bias"])) < CLOSE
        assert off(places_of(model, links)(q), state["places"]) < CLOSE


def test_dampers_and_dry_friction_act_against_the_motion():
    model = arm(creep=1e-6)
    force = terms_of(model)(np.zeros(4), np.array([2.0, -3, 1, 1]), np.zeros(0)).force
    assert force == pytest.approx([-0.7 * 2 - 0.2, 0.5 * 3, 0, 0], rel=1e-9)


def test_limits_are_bounds_and_motors_controls():
    model = arm(motors="all")
    assert model.system().control_names == ("swing_u", "lift_u", "reach_u", "left_finger_u")
    assert model.joints["swing"].limits == mb.Limits()
    assert model.joints["lift"].limits == mb.Limits(-1, 2, 3, 80)
    bounds = {str(x): (low, high) for low, x, high in model.bounds()}
    assert bounds["lift"] == (-1, 2) and bounds["lift_dot"] == (-3, 3)
    assert bounds["lift_u"] == (-80, 80) and "reach_dot" not in bounds
    assert arm(motors=["lift"]).system().control_names == ("lift_u",)


def test_a_floating_base_falls_freely_and_keeps_its_momentum():
    """The momentum of the base's position is that of the whole: it falls whatever joints do."""
    link = (
        '<link name="{}"><inertial><origin xyz="0.1 0.2 0"/><mass value="{}"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2"/></inertial></link>'
    )
    text = f"""<robot name="r">{link.format("a", 1)}{link.format("b", 2)}
      <joint name="j" type="continuous"><origin xyz="0.5 0 0"/><parent link="a"/><child link="b"/>
        <axis xyz="0 1 1"/></joint></robot>"""
    model = mb.from_urdf(text, base="free")
    q0, v0 = np.zeros(8), np.array([0.5, 0, 0, 0, 0.1, 0.2, -0.1, 1.0])
    q0[[3, 7]] = 1.0, 0.3
    motion = vi.simulate(model.system(), vi.trapezoidal(), q0=q0, v0=v0, h=0.01, steps=20)
    weight = np.outer(motion.t, [0, 0, -3 * 9.81])
    assert motion.p[:, :3] - motion.p[0, :3] == pytest.approx(weight, abs=1e-12)
    assert np.ptp(motion.q[:, 7]) > 0.1


def test_shapes_are_kept_for_drawings():
    bodies = arm().bodies
    [cylinder], [box] = bodies["turret"].visuals, bodies["boom"].visuals
    assert (cylinder.kind, cylinder.size) == ("cylinder", (0.1, 0.1))
    assert cylinder.colour == (0.6, 0.6, 0.7, 1.0)
    assert (box.kind, box.size) == ("box", (0.3, 0.03, 0.04))
    assert box.placement.position == pytest.approx([0.3, 0, 0])


def test_what_is_not_used_is_said_once_with_its_lines():
    text = """<robot name="r">
      <link name="a"/>
      <gazebo reference="a"/>
      <link name="b"><inertial><mass value="1"/>
        <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/>
        <limit lower="0" upper="1" effort="0" velocity="1"/></joint>
      <gazebo/>
      <transmission/>
    </robot>"""
    with pytest.warns(UserWarning) as said:
        model = mb.from_urdf(text)
    assert [str(w.message) for w in said] == [
        "text: read without <gazebo> on lines 3, 8; <transmission> on line 9; "
        "<limit> effort=0 (read as no limit) on line 7"
    ]
    assert model.joints["j"].axes.tolist() == [[1, 0, 0]]
