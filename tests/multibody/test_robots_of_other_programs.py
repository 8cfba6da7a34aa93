"""Whole robots against Pinocchio and MuJoCo themselves, where these are installed."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from machine_terms import kinematic_matrix, off, places_of, terms_of

import varint as vi
import varint.multibody as mb

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore:.*read without")]
CLOSE, STATES = 1e-12, 3
# one robot of each maker and kind: arms, hands, legs, wheels, wings
ROBOTS = [
    "ur_description/urdf/ur3_robot",
    "ur_description/urdf/ur5_robot",
    "ur_description/urdf/ur10_robot",
    "panda_description/urdf/panda",
    "kinova_description/robots/kinova",
    "xarm_description/urdf/xarm7",
    "z1_description/urdf/z1",
    "so_arm_description/urdf/so100",
    "a1_description/urdf/a1",
    "anymal_b_simple_description/robots/anymal",
    "anymal_c_simple_description/urdf/anymal",
    "go1_description/urdf/go1",
    "go2_description/urdf/go2",
    "hyq_description/robots/hyq_no_sensors",
    "laikago_description/urdf/laikago",
    "solo_description/robots/solo12",
    "b1_description/urdf/b1-z1",
    "bolt_description/robots/bolt",
    "finger_edu_description/robots/finger_edu",
    "allegro_hand_description/urdf/allegro_left_hand",
    "baxter_description/urdf/baxter",
    "double_pendulum_description/urdf/double_pendulum",
    "hextilt_description/urdf/hextilt_flying_arm_5",
    "simple_humanoid_description/urdf/simple_humanoid",
]
MODELS = [
    "ant",
    "half_cheetah",
    "hopper",
    "humanoid",
    "humanoidstandup",
    "inverted_double_pendulum",
    "inverted_pendulum",
    "point",
    "pusher",
    "pusher_v5",
    "reacher",
    "swimmer",
    "walker2d",
    "walker2d_v5",
]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_moves_as_in_pinocchio(name):
    pin = pytest.importorskip("pinocchio")
    share = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
    path = share / f"{name}.urdf"
    if not path.exists():
        pytest.skip("needs example-robot-data")
    model, theirs = mb.from_urdf(path), pin.buildModelFromUrdf(str(path))
    names, data = model.system().names, theirs.createData()
    joints = {x: theirs.joints[theirs.getJointId(x)] for x in list(theirs.names)[1:]}
    led = {x.follower: x for x in model.machine.couplings}
    slopes = np.zeros((theirs.nv, len(names)))
    for x, joint in joints.items():
        coupled = led.get(x)
        slope = 1.0 if coupled is None else coupled.coefficients[1]
        slopes[joint.idx_v, names.index(x if coupled is None else coupled.leader)] = slope
    links = [x for x in model.bodies if theirs.existBodyName(x)][:30]
    terms, places, random = terms_of(model), places_of(model, links), np.random.default_rng(1)
    for _ in range(STATES):
        q, v = random.normal(size=(2, len(names)))
        theirs_q = np.zeros(theirs.nq)
        for x, joint in joints.items():
            coupled = led.get(x)
            angle = (
                q[names.index(x)]
                if coupled is None
                else coupled.coefficients[0]
                + coupled.coefficients[1] * q[names.index(coupled.leader)]
            )
            theirs_q[joint.idx_q : joint.idx_q + joint.nq] = (
                (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
            )
        found = terms(q, v, np.zeros(0))
        upper = np.triu(pin.crba(theirs, data, theirs_q))
        mass = upper + np.triu(upper, 1).T
        assert off(found.mass_matrix, slopes.T @ mass @ slopes) < CLOSE
        bias = pin.nonLinearEffects(theirs, data, theirs_q, slopes @ v)
        assert off(found.bias, slopes.T @ bias) < CLOSE
        pull = pin.computeGeneralizedGravity(theirs, data, theirs_q)
        assert off(terms(q, 0 * v, np.zeros(0)).bias, slopes.T @ pull) < CLOSE
        pin.framesForwardKinematics(theirs, data, theirs_q)
        spots = [data.oMf[theirs.getBodyId(x)] for x in links]
        expected = [np.append(x.translation, x.rotation.ravel()) for x in spots]
        assert off(places(q), np.array(expected)) < CLOSE


@pytest.mark.parametrize("name", MODELS)
def test_a_model_moves_as_in_mujoco(name):
    mujoco = pytest.importorskip("mujoco")
    gymnasium = pytest.importorskip("gymnasium")
    path = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / f"{name}.xml"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model, theirs = mb.from_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    off_flags = mujoco.mjtDisableBit
    theirs.opt.disableflags |= off_flags.mjDSBL_CONTACT | off_flags.mjDSBL_LIMIT
    data, random = mujoco.MjData(theirs), np.random.default_rng(1)
    bodies = [x for x in model.bodies if "/" not in x]
    terms, places = terms_of(model), places_of(model, bodies)
    for _ in range(STATES):
        data.qpos[:], data.qvel[:] = random.normal(size=theirs.nq), random.normal(size=theirs.nv)
        low, high = np.where(
            theirs.actuator_ctrllimited[:, None], theirs.actuator_ctrlrange, [-1, 1]
        ).T
        data.ctrl[:] = random.uniform(low, high)
        mujoco.mj_normalizeQuat(theirs, data.qpos)
        mujoco.mj_forward(theirs, data)
        found = terms(data.qpos, data.qvel, data.ctrl)
        mass = np.zeros((theirs.nv, theirs.nv))
        for row, unit in zip(mass, np.eye(theirs.nv), strict=True):
            mujoco.mj_mulM(theirs, data, row, unit)
        assert off(found.mass_matrix, mass) < CLOSE
        assert off(found.bias, data.qfrc_bias) < CLOSE
        assert off(found.spring + found.force, data.qfrc_passive + data.qfrc_actuator) < CLOSE
        assert off(places(data.qpos), np.hstack([data.xpos, data.xmat])[1:]) < CLOSE


@pytest.mark.parametrize("name", ["half_cheetah", "swimmer", "driven"])
def test_a_driven_motion_is_that_of_mujoco_at_small_steps(name, tmp_path, monkeypatch):
    """Springs, dampers, rotors, motors, a medium and a floating body; RK4 there."""
    mujoco = pytest.importorskip("mujoco")
    gymnasium = pytest.importorskip("gymnasium")
    monkeypatch.chdir(tmp_path)  # it leaves a log
    path = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / f"{name}.xml"
    if name == "driven":
        path = Path(__file__).parents[1] / "reference" / "machines" / "driven.xml"
    model, theirs = mb.from_mjcf(path), mujoco.MjModel.from_xml_path(str(path))
    flags, h, duration = mujoco.mjtDisableBit, 2.0**-13, 0.5
    theirs.opt.disableflags |= flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT
    theirs.opt.integrator, theirs.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, h
    data, random = mujoco.MjData(theirs), np.random.default_rng(3)
    data.qvel[:], data.ctrl[:] = random.normal(size=theirs.nv), 0.1
    (q0, _), nu = mb.start_values(model), data.qvel.copy()
    assert off(q0, data.qpos) < CLOSE
    for _ in range(round(duration / h)):
        mujoco.mj_step(theirs, data)
    scene = model.system()
    motion = vi.simulate(
        scene,
        vi.lobatto(3) if scene.constraint.numel() else vi.gauss(3),
        q0=q0,
        v0=kinematic_matrix(model, q0) @ nu,
        h=2.0**-9,
        duration=duration,
        u=np.full(theirs.nu, 0.1),
    )
    assert off(motion.q[-1], data.qpos) < 1e-7
