"""Writes `g.json`: what MuJoCo and Pinocchio make of the files in `machines/` at random states.

Run: python tests/reference/machine_numbers.py, with `mujoco` and `pin`. Of a machine of MuJoCo:
mass matrix M, bias c(q, v) with M v̇ + c = forces, forces of springs, dampers and actuators, places
of bodies and sites, violations of the equality constraints. Of Pinocchio: M, c, places of links;
its coordinates are those of all joints, followers included.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
STATES = 2


def of_mujoco(path: Path) -> list[dict]:
    """What MuJoCo computes of a model at random states, contacts and limits left out."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
    data, random, found = mujoco.MjData(model), np.random.default_rng(7), []
    for _ in range(STATES):
        data.qpos[:] = random.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:] = random.normal(size=model.nv)
        low, high = np.where(
            model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-1, 1]
        ).T
        data.ctrl[:] = random.uniform(low, high)
        mujoco.mj_forward(model, data)
        columns = []
        for unit in np.eye(model.nv):
            column = np.zeros(model.nv)
            mujoco.mj_mulM(model, data, column, unit)
            columns.append(column)
        named = {"q": data.qpos, "v": data.qvel, "u": data.ctrl, "bias": data.qfrc_bias}
        forces = {"passive": data.qfrc_passive, "actuator": data.qfrc_actuator}
        violated = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        places = {
            "bodies": np.hstack([data.xpos, data.xmat])[1:],
            "sites": np.hstack([data.site_xpos, data.site_xmat]),
        }
        state = named | forces | places | {"mass_matrix": np.array(columns), "equality": violated}
        found.append({name: np.array(value).tolist() for name, value in state.items()})
    return found


def of_pinocchio(path: Path) -> list[dict]:
    """What Pinocchio computes of a robot with a fixed base at random states."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(path))
    data, random, found = model.createData(), np.random.default_rng(7), []
    for _ in range(STATES):
        angles, v = random.normal(size=model.nv), random.normal(size=model.nv)
        names = list(model.names)[1:]
        # right_finger follows left_finger
        k, leader = names.index("right_finger"), names.index("left_finger")
        angles[k], v[k] = 0.1 - 0.8 * angles[leader], -0.8 * v[leader]
        q = np.zeros(model.nq)
        for joint, angle in zip(list(model.joints)[1:], angles, strict=True):
            turns = joint.nq == 2
            q[joint.idx_q : joint.idx_q + joint.nq] = (
                (np.cos(angle), np.sin(angle)) if turns else angle
            )
        upper = np.triu(pin.crba(model, data, q))
        bias = pin.nonLinearEffects(model, data, q, v)
        pin.framesForwardKinematics(model, data, q)
        links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY][1:]
        places = [data.oMf[model.getBodyId(name)] for name in links]
        found.append(
            {
                "joints": names,
                "q": angles.tolist(),
                "v": v.tolist(),
                "mass_matrix": (upper + np.triu(upper, 1).T).tolist(),
                "bias": bias.tolist(),
                "links": links,
                "places": [[*x.translation.tolist(), *x.rotation.ravel().tolist()] for x in places],
            }
        )
    return found


if __name__ == "__main__":
    table = {path.name: of_mujoco(path) for path in sorted((HERE / "machines").glob("*.xml"))}
    table |= {path.name: of_pinocchio(path) for path in sorted((HERE / "machines").glob("*.urdf"))}
    (HERE / "g.json").write_text(json.dumps(table) + "\n", encoding="utf-8")
