"""How machines are built: names, placements, start values, rotations, and what is refused."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest
from machines import plane_chain, spatial_chain

import varint as vi
import varint.multibody as mb
from varint.scene.kinetics import Kinetics


def hinge(**options) -> tuple[mb.Model, mb.Body]:
    world = mb.Model()
    arm = world.body(1.0, (1, 0, 0), 0.1, "arm")
    world.revolute(world, arm, (0, -1, 0), **options)
    return world, arm


def refused(match: str, act) -> None:
    with pytest.raises(vi.InputError, match=match):
        act()


def test_the_model_itself_stands_for_the_ground_wherever_a_body_may_be_given():
    world, arm = hinge()
    at = (0.0, 0.0, 1.0)
    marker, rod = world.marker(world, at=at), world.loop("distance", (world, at), arm, length=1.0)
    spring = world.spring((arm, at), (world, at), 1.0)
    for anchor in (marker, rod.a, spring.b):
        assert anchor.body == "world"
    for place in (world.frame(marker).position, world.frame((world, at)).position):
        assert np.array_equal(ca.DM(place).full().ravel(), at)
    refused("ground cannot be the child", lambda: world.revolute(arm, world))


def test_what_cannot_be_a_machine_is_refused_with_the_remedy():
    world, arm = hinge()
    refused("leads to body 'arm' already", lambda: world.free(world, arm))
    leg = world.body(1.0, name="leg")
    refused("unknown body 'knee'", lambda: world.free("knee", leg))
    refused("not taken, got 'arm'", lambda: world.body(name="arm"))
    refused("not negative|must not be negative", lambda: world.body(-1.0))
    refused("not symmetric", lambda: world.body(1.0, inertia=[[1, 1, 0], [0, 1, 0], [0, 0, 1]]))
    refused("negative principal moment", lambda: world.body(1.0, inertia=(1, -1, 1)))
    refused("unknown kind of loop", lambda: world.loop("knot", arm, "world"))
    refused("upon itself", lambda: world.loop("point", arm, (arm, (1, 0, 0))))
    refused("length belongs", lambda: world.loop("distance", arm, "world"))
    refused("unknown joint 'knee'", lambda: world.motor("knee"))
    refused("cannot follow", lambda: world.mimic("arm", "arm"))
    refused("no number 'arm.colour'", lambda: world.symbolic("arm.colour"))
    refused("unknown frame", lambda: world.frame("hand"))
    refused("no rotation matrix", lambda: mb.placed((0, 0, 0), np.ones((3, 3))))
    refused("norm 1", lambda: mb.placed((0, 0, 0), (1, 1, 0, 0)))
    loose = mb.Model()
    loose.body(1.0, name="stone")
    refused("nothing can move", loose.system)
    loose.revolute(loose, loose.body(1.0, inertia=1.0, name="wheel"))
    refused(r"bodies \['stone'\] hang on nothing", loose.system)


def link(world, kind, name, mass=0.0, inertia=0.0, com=(0.0, 0.0, -0.5), parent="world", **joint):
    world.body(mass, com, inertia, name)
    getattr(world, kind)(parent, name, name=f"{name}_joint", **joint)
    return world


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "universal", "planar", "spherical"])
def test_a_joint_that_moves_nothing_is_told_when_the_scene_is_made(kind):
    """A link without inertia was refused at the run, as a test particle or for its velocities."""
    world = link(mb.Model(), "revolute", "arm", 1.0, 0.1, axis=(0, 1, 0))
    link(world, "fixed", "cap", parent="arm")
    world.system()
    link(link(world, kind, "hand", parent="arm"), "fixed", "nail", parent="hand")
    told = r"'hand_joint' moves \['hand', 'nail'\] without mass and inertia.*<inertial>"
    refused(told, world.system)


def test_what_is_lacking_is_named():
    axis = np.array([0.3, -0.2, 0.5])
    spun = link(mb.Model(), "revolute", "rod", 1.0, com=0.7 * axis, axis=axis)
    refused("'rod_joint' moves 'rod' without inertia about its axis", spun.system)
    refused("without mass, so", link(mb.Model(), "prismatic", "block", inertia=1.0).system)
    refused("without mass, so", link(mb.Model(), "free", "ghost", inertia=1.0).system)
    needle = {"mass": 1.0, "inertia": (1 / 12, 1 / 12, 0)}
    for kind in ("spherical", "free"):
        refused(r"a needle.*universal", link(mb.Model(), kind, "rod", **needle).system)


def test_bodies_without_mass_are_welcome_where_others_move_with_them():
    """Between hinges, under a rotor, as a follower, as an unknown, and where a loop holds it."""
    between = link(mb.Model(), "revolute", "cross", axis=(1, 0, 0))
    link(between, "revolute", "rod", 1.0, 0.1, parent="cross", axis=(0, 1, 0))
    rotor = link(mb.Model(), "revolute", "disc", passive=mb.Passive(armature=0.2))
    gear = link(link(mb.Model(), "revolute", "big", 1.0, 0.1), "revolute", "small")
    gear.mimic("small_joint", "big_joint", -2.0)
    unknown = link(mb.Model(), "revolute", "rod", axis=(0, 1, 0))
    unknown.symbolic("rod.mass")
    for model, n in ((between, 2), (rotor, 1), (gear, 1), (unknown, 1)):
        assert model.system().structure.n == n
    four = mb.Model()
    for name, mass, at, parent in (
        ("crank", 1.0, (0, 0, 0), "world"),
        ("coupler", 0.0, (1, 0, 0), "crank"),
        ("rocker", 1.0, (1, 0, 0), "world"),
    ):
        side = (0.5, 0, 0)
        link(four, "revolute", name, mass, mass / 12, side, parent, axis=(0, 1, 0), at=at)
    four.loop("line", ("coupler", (1, 0, 0)), ("rocker", (1, 0, 0)))
    assert four.system().structure.n == 3


def test_moments_that_no_rigid_body_has_are_refused():
    """A plate has I1 + I2 = I3, and no body has less; they were taken in silence."""
    turn = mb.roll_pitch_yaw(0.3, -0.7, 1.1)
    world = mb.Model()
    for moments in ((1, 1, 2), (0, 1, 1), (0, 0, 3), 0.4, (1, 1, 2 * (1 + 1e-12))):
        world.body(1.0, inertia=moments)
        world.body(1.0, inertia=turn @ np.diag(np.broadcast_to(moments, 3)) @ turn.T)
    for moments in ((1, 1, 3), (1, 1, 2.001), (0, 1, 1.1)):
        for inertia in (moments, turn @ np.diag(moments) @ turn.T):
            told = "principal moments .* of body 'box': none is larger than the sum"
            refused(told, lambda inertia=inertia: world.body(1.0, inertia=inertia, name="box"))
    assert "box" not in world.bodies


def test_moments_that_no_rigid_body_has_are_told_of_files():
    """MuJoCo refuses such files, others do not; numbers of few digits break it slightly."""
    urdf = """<robot name="r"><link name="ceiling"/><link name="rod"><inertial><mass value="2"/>
      <inertia ixx="0.1" iyy="0.1" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="hinge" type="continuous"><parent link="ceiling"/><child link="rod"/>
      </joint></robot>"""
    mjcf = """<mujoco><worldbody><body name="rod"><joint name="hinge"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 {0}"/></body></worldbody></mujoco>"""
    for read, text in ((mb.from_urdf, urdf), (mb.from_mjcf, mjcf)):
        with pytest.warns(UserWarning, match=r"moments of \['rod'\], of the first \(0.1, 0.1, 0.3"):
            model = read(text.format(0.3))
        assert model.bodies["rod"].inertia[2, 2] == 0.3
        read(text.format(0.201)), read(text.format(0.2))


def test_a_loop_that_is_open_whatever_the_coordinates_are_is_refused():
    world = plane_chain(2)
    world.loop("point", ("link1", (0, 0, -1)), ("world", (1.0, 0.3, -1.0)))
    refused("is open by -?0.3 whatever", world.system)


def test_a_joint_may_stand_anywhere_in_both_bodies():
    """The same arm with its frame at the joint and at its centre of mass."""
    first, _ = hinge()
    second = mb.Model()
    arm = second.body(1.0, (0, 0, 0), 0.1, "arm")
    second.revolute(second, arm, (0, -1, 0), child_at=(-1, 0, 0))
    for q in (0.0, 0.7):
        for model in (first, second):
            assert np.isclose(float(model.dynamics.mass_matrix(q)), 1.1, rtol=1e-15)
            assert np.isclose(float(model.dynamics.gravity(q)), 9.81 * np.cos(q), rtol=1e-14)


def test_numbers_become_parameters_and_keep_their_values():
    world, _ = hinge(passive=mb.Passive(damping=0.2))
    plain = world.system()
    names = ["arm.mass", "arm.com", "arm.inertia", "arm.damping", "arm.position", "gravity"]
    c = world.symbolic(*names)
    system = world.system()
    assert list(system.defaults) == [name.replace(".", "_") for name in names]
    runs = [
        vi.simulate(s, q0=0.3, v0=0.1, h=0.01, steps=20, **extra)
        for s, extra in ((plain, {}), (system, {}), (system, {"params": {"arm_mass": 2.0}}))
    ]
    assert abs(runs[0].q - runs[1].q).max() <= 1e-14
    assert abs(runs[0].q - runs[2].q).max() > 1e-4
    heavy = world.dynamics.mass_matrix(0.0, system.default_vector)
    assert np.isclose(float(heavy), 1.1) and "arm_mass" in c


def test_start_values_are_unit_quaternions_with_the_rates_of_angular_velocities():
    world = mb.Model()
    world.free(world, world.body(1.0, inertia=1.0, name="stone"))
    turn, omega = np.array([1.0, -2.0, 0.5, 3.0]), [0.3, -0.2, 0.7]
    q0, v0 = mb.start_values(world, {"stone": [1, 2, 3, *turn]}, {"stone": [4, 5, 6, *omega]})
    assert np.isclose(np.linalg.norm(q0[3:]), 1.0, rtol=1e-15) and abs(q0[3:] @ v0[3:]) <= 1e-15
    frame = world.frame("stone")
    spin = ca.Function("w", [world.q, world.v], [frame.rotation.T @ frame.angular_velocity])
    assert np.allclose(np.array(spin(q0, v0)).ravel(), omega, atol=1e-15)
    refused("is zero: no rotation", lambda: mb.start_values(world, {"stone": np.zeros(7)}))
    refused(r"must be \(6,\)", lambda: mb.start_values(world, {}, {"stone": [1, 2]}))


def test_between_the_nodes_quaternions_stay_on_the_sphere():
    world = mb.Model()
    world.spherical(world, world.body(1.0, (0, 0, 0.5), (0.75, 0.75, 0.5), "top"))
    q0, v0 = mb.start_values(world, {"top": [0.9, 0.43, 0, 0]}, {"top": [0.0, 0.0, 10.0]})
    dense = vi.simulate(world.system(), q0=q0, v0=v0, h=0.01, steps=20).at(np.linspace(0, 0.2, 77))
    assert abs(np.linalg.norm(dense.q, axis=1) - 1).max() <= 1e-14
    assert abs((dense.q * dense.v).sum(axis=1)).max() <= 1e-12


@pytest.mark.parametrize("order", ["zyx", "xyz", "yzx", "xzy", "zxz", "xyx", "zyz", "yxy"])
def test_euler_angles_make_the_rotation_that_they_were_read_from(order):
    axes = dict(zip("xyz", np.eye(3), strict=True))
    turns = [*np.random.default_rng(3).uniform(-3, 3, size=(20, 3)), [0.4, 0.0, 0.0]]
    edge = 0.0 if order[0] == order[2] else np.pi / 2
    for angles in (*turns, [0.4, edge, 0.2]):
        made = [mb.axis_rotation(axes[x], a) for x, a in zip(order, angles, strict=True)]
        wanted = made[0] @ made[1] @ made[2]
        read = mb.euler_angles(wanted, order)
        back = [mb.axis_rotation(axes[x], a) for x, a in zip(order, read, strict=True)]
        assert abs(back[0] @ back[1] @ back[2] - wanted).max() <= 1e-12
        assert abs(mb.euler_angles(mb.matrix_quaternion(wanted), order) - read).max() <= 1e-7


def test_kinetics_travel_with_the_system_and_must_be_those_of_its_lagrangian():
    system = spatial_chain(3).system()
    copy = pickle.loads(pickle.dumps(system))
    q, v = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.0])
    for s in (system, copy):
        p = ca.Function("p", [s.q, s.v], [s.momentum])(q, v)
        back = ca.Function("v", [s.q, s.kinetics.momentum], [s.kinetics.velocity])(q, p)
        assert np.allclose(np.array(back).ravel(), v, rtol=1e-13)
        slopes = np.array(ca.Function("dL", [s.q, s.v], [s.kinetics.slopes])(q, v)).ravel()
        assert np.allclose(slopes[3:], np.array(p).ravel(), rtol=1e-13)
    wrong = Kinetics(2 * system.kinetics.mass_matrix)
    parts = system.q, system.v, system.lagrangian
    refused("mass matrix of kinetics is not", lambda: vi.System(*parts, kinetics=wrong))
    p = ca.SX.sym("p", 3)
    wrong = Kinetics(system.kinetics.mass_matrix, p, p)
    refused("velocity of kinetics is not", lambda: vi.System(*parts, kinetics=wrong))


@pytest.mark.parametrize("stages", [2, 4, 8])
def test_stages_improved_by_their_defects_are_those_of_newton(stages):
    """The loop for scenes that know v(q, p) solves the same equations, to round-off."""
    system = spatial_chain(4).system()
    start = {"q0": [0.3, -0.2, 0.4, 0.1], "v0": [0.5, 1.0, -0.5, 0.3], "h": 0.01, "steps": 40}
    fast, newton = (
        vi.simulate(system, vi.gauss(stages), **start, backend=backend)
        for backend in ("native", "interpreted")
    )
    assert "Gauss" in fast.stats["backend"] and newton.stats["backend"] == "interpreted"
    assert abs(fast.q - newton.q).max() <= 1e-14
    assert abs(fast.p - newton.p).max() <= 1e-13


def test_the_iteration_contracts_in_long_chains():
    """Twenty links: h ‖M⁻¹ (∂p/∂q − its transpose)‖, by which V from P contracts, is above one, and
    the loop needs few evaluations all the same.
    """
    links, h = 20, 2e-3
    system = spatial_chain(links).system()
    q0, v0 = 0.3 * np.cos(np.arange(links)), 0.05 * np.sin(np.arange(links))
    slope = ca.jacobian(system.momentum, system.q)
    parts = ca.Function("parts", [system.q, system.v], [system.mass_matrix, slope - slope.T])
    mass, gyroscopic = map(np.array, parts(q0, v0))
    assert h * np.linalg.norm(np.linalg.solve(mass, gyroscopic), 2) > 1
    motion = vi.simulate(system, vi.gauss(2), q0=q0, v0=v0, h=h, steps=20, backend="native")
    assert "Gauss" in motion.stats["backend"]
    assert motion.stats["iterations"] <= 20 * 20


@pytest.mark.long
def test_a_chain_of_a_hundred_links_is_solved():
    """Two rules and steps agree, energy is kept to round-off, and evaluations are few."""
    links = 100
    system = spatial_chain(links).system()
    start = dict(q0=0.3 * np.cos(np.arange(links)), v0=0.05 * np.sin(np.arange(links)))
    runs = [
        vi.simulate(system, rule, **start, h=h, duration=0.02, backend="native")
        for rule, h in ((vi.gauss(4), 1e-4), (vi.gauss(6), 2e-4))
    ]
    assert abs(runs[0].q[-1] - runs[1].q[-1]).max() <= 1e-9
    for motion in runs:
        assert "Gauss" in motion.stats["backend"]
        assert np.ptp(motion.energy) <= 1e-13 * abs(motion.energy[0])
        assert motion.stats["iterations"] <= 10 * motion.stats["steps"]
