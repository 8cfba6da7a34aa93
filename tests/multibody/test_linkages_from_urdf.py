"""Closed linkages from URDF, which has none: a tree, and loops that close it."""

from __future__ import annotations

import numpy as np
import pytest
from references import given_and_exact

import varint as vi
import varint.multibody as mb

LINK = """<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="{2}"/>
  <inertia ixx="1e-4" ixy="0" ixz="0" iyy="{3}" iyz="0" izz="{3}"/></inertial></link>"""
HINGE = """<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/>
  <origin xyz="{3} 0 0"/><axis xyz="0 1 0"/></joint>"""


def rod(name: str, length: float) -> str:
    """A uniform rod of 1 kg/m along x."""
    return LINK.format(name, length / 2, length, length**3 / 12)


def angle_of(first: float, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Freudenstein's rocker angle of a four-bar linkage, the open way of assembly."""
    x, z = ground - crank * np.cos(first), -crank * np.sin(first)
    far = np.hypot(x, z)
    inner = np.arccos((rocker**2 + far**2 - coupler**2) / (2 * rocker * far))
    return np.arctan2(-z, -x) - inner


def test_a_four_bar_linkage_turns_as_freudenstein_says():
    crank, coupler, rocker, ground = 0.2, 0.7, 0.5, 0.6
    model = mb.from_urdf(
        f"""<robot name="four bars"><link name="world"/>
        {rod("crank", crank)}{rod("coupler", coupler)}{rod("rocker", rocker)}
        {HINGE.format("a", "world", "crank", 0)}{HINGE.format("b", "crank", "coupler", crank)}
        {HINGE.format("d", "world", "rocker", ground)}</robot>"""
    )
    model.loop("point", ("coupler", (coupler, 0, 0)), ("rocker", (rocker, 0, 0)), name="closure")
    system = model.system()
    assert system.constraint.numel() == 2  # out of the plane nothing is left to hold
    first = 0.9  # turns about +y lower the x-axis: z = −sin
    last = -angle_of(-first, crank, coupler, rocker, ground)
    tip = np.array([ground + rocker * np.cos(last), -rocker * np.sin(last)])
    knee = np.array([crank * np.cos(first), -crank * np.sin(first)])
    middle = np.arctan2(-(tip - knee)[1], (tip - knee)[0]) - first
    motion = vi.simulate(system, q0=[first, middle, last], v0=np.zeros(3), h=0.01, steps=70)
    assert np.ptp(motion.q[:, 0]) > 0.2
    expected = [-angle_of(-x, crank, coupler, rocker, ground) for x in motion.q[:, 0]]
    assert np.unwrap(motion.q[:, 2]) == pytest.approx(np.unwrap(expected), abs=1e-9)
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-6


def test_a_slider_crank_slides_as_its_triangle_says():
    crank, length = 0.2, 0.5
    block = LINK.format("block", 0, 0.3, 1e-4)
    model = mb.from_urdf(
        f"""<robot name="engine"><link name="world"/>
        {rod("crank", crank)}{rod("rod", length)}{block}
        {HINGE.format("a", "world", "crank", 0)}{HINGE.format("b", "crank", "rod", crank)}
        <joint name="slide" type="prismatic"><parent link="world"/><child link="block"/></joint>
        </robot>"""
    )
    model.loop("point", ("rod", (length, 0, 0)), "block")
    turn, speed = 0.7, 6.0
    lean = -np.arcsin(crank * np.sin(turn) / length) - turn
    place = crank * np.cos(turn) + np.sqrt(length**2 - (crank * np.sin(turn)) ** 2)
    system = model.system()
    start = vi.project(system, [turn, lean, place], [speed, 0.0, 0.0])
    motion = vi.simulate(system, q0=start[0], v0=start[1], h=0.005, steps=200)
    angle = motion.q[:, 0]
    assert np.ptp(angle) > 2
    expected = crank * np.cos(angle) + np.sqrt(length**2 - (crank * np.sin(angle)) ** 2)
    assert motion.q[:, 2] == pytest.approx(expected, abs=1e-9)
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-6


def test_the_slider_crank_of_the_literature_is_where_its_exact_reduction_is():
    given, exact = given_and_exact("c", "C_slider_crank_rigid")
    crank, length = given["l1"], given["l2"]
    links = (
        LINK.format("crank", crank / 2, given["m1"], given["J1_com"])
        + LINK.format("rod", length / 2, given["m2"], given["J2_com"])
        + LINK.format("block", 0, given["m3"], 1e-4)
    )
    hinges = HINGE.format("phi", "world", "crank", 0) + HINGE.format("b", "crank", "rod", crank)
    model = mb.from_urdf(
        f"""<robot name="engine"><link name="world"/>{links}{hinges}
        <joint name="slide" type="prismatic"><parent link="world"/><child link="block"/></joint>
        </robot>""".replace('xyz="0 1 0"', 'xyz="0 -1 0"'),
        gravity=(0, 0, -given["g"]),
    )
    model.loop("point", ("rod", (length, 0, 0)), "block")
    phi, psi, rates = 0.3, -0.14830313118757033, (20.0, -9.659393823958915)
    place = crank * np.cos(phi) + length * np.cos(psi)
    speed = -crank * np.sin(phi) * rates[0] - length * np.sin(psi) * rates[1]
    motion = vi.simulate(
        model.system(),
        q0=[phi, psi - phi, place],
        v0=[rates[0], rates[1] - rates[0], speed],
        duration=0.2,
        tol=1e-9,
    )
    for t, q in zip((0.05, 0.1), exact["q"], strict=False):
        found = motion.at(t).q
        assert [found[0], found[0] + found[1], found[2]] == pytest.approx(
            [q[2], q[5], q[6]], abs=1e-8
        )


def test_two_four_bars_in_a_row_fall_as_one_angle_does():
    """IFToMM's N-four-bar mechanism, from a tree of five rods and two closures."""
    given, exact = given_and_exact("c", "C_N_four_bar_N2")
    inertia = 1 / 12
    upright = (
        LINK.replace('xyz="{1} 0 0"', 'xyz="0 0 0.5"')
        .replace('ixx="1e-4"', f'ixx="{inertia}"')
        .replace('izz="{3}"', 'izz="1e-4"')
    )
    links = "".join(upright.format(f"r{k}", 0, 1, inertia) for k in range(3))
    links += "".join(LINK.format(f"h{k}", 0.5, 1, inertia) for k in (1, 2))
    joints = "".join(HINGE.format(f"t{k}", "world", f"r{k}", k) for k in range(3))
    joints += "".join(
        HINGE.format(f"b{k}", f"r{k - 1}", f"h{k}", 0).replace('xyz="0 0 0"', 'xyz="0 0 1"')
        for k in (1, 2)
    )
    model = mb.from_urdf(
        f'<robot name="bars"><link name="world"/>{links}{joints}</robot>',
        gravity=(0, 0, -given["g"]),
    )
    for k in (1, 2):
        model.loop("point", (f"h{k}", (1, 0, 0)), (f"r{k}", (0, 0, 1)))
    motion = vi.simulate(model.system(), q0=np.zeros(5), v0=[1, 1, 1, -1, -1], h=0.01, steps=50)
    angle, rate = motion.q[-1, 0], motion.v[-1, 0]
    found = [np.sin(angle), np.cos(angle), rate * np.cos(angle), -rate * np.sin(angle)]
    assert found == pytest.approx(exact["state"][0][:4], abs=1e-7)
    assert np.ptp(motion.q[:, :3], axis=1).max() < 1e-12  # the uprights stay parallel
