"""Models with constraints, contacts and rolling against recomputed reference values and the
models in angles.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from references import entries

import varint as vi
from varint import models

MECHANICS, MULTIBODY = entries("a"), entries("c")


def test_andrews_mechanism_squeezes_as_recomputed_in_multipliers_too():
    model, entry = models.andrews_mechanism(), MULTIBODY["C_andrews"]
    motion = vi.simulate(
        model.system, vi.lobatto(5), q0=model.q0, v0=model.v0, h=5e-5, duration=0.03
    )
    for time, state in zip(entry["times"][:4], np.array(entry["reference"]["state"]), strict=False):
        k = round(time / 5e-5)
        np.testing.assert_allclose(motion.q[k], state[:7], rtol=0, atol=1e-9)
        np.testing.assert_allclose(
            motion.v[k], state[7:14], rtol=0, atol=1e-8 * np.abs(state[7:14]).max()
        )
        lam = -state[21:]  # the source writes M q̈ = f − Gᵀλ
        np.testing.assert_allclose(
            motion.multipliers[k], lam, rtol=0, atol=1e-7 * np.abs(lam).max()
        )
    np.testing.assert_allclose(motion.energy, motion.energy[0], rtol=1e-9)


def test_the_slider_crank_has_the_motion_of_its_one_freedom_and_the_joint_forces_of_the_balance():
    model, entry = models.slider_crank(), MULTIBODY["C_slider_crank_rigid"]
    motion = vi.simulate(
        model.system, vi.lobatto(5), q0=model.q0, v0=model.v0, h=1e-3, duration=1.0
    )
    reference = entry["reference"]
    for k, time in enumerate(entry["times"]):
        state, lam = motion.at(time), motion.at([time]).multipliers[0]
        np.testing.assert_allclose(state.q, reference["q"][k], rtol=0, atol=1e-11)
        np.testing.assert_allclose(state.v, reference["v"][k], rtol=0, atol=1e-9)
        forces = [*lam[:2], *-lam[2:6], lam[6]]
        np.testing.assert_allclose(forces, reference["joint_forces"][k], rtol=0, atol=1e-9)


def test_parallel_cranks_turn_through_the_folded_position_on_the_parallel_branch():
    model, entry = models.four_bar(), MULTIBODY["C_N_four_bar_N2"]
    motion = vi.simulate(
        model.system, vi.lobatto(5), q0=model.q0, v0=model.v0, h=0.0031, duration=0.0031 * 1300
    )
    for time, state in zip(entry["times"][:4], entry["reference"]["state"], strict=False):
        found = motion.at(time)
        np.testing.assert_allclose([*found.q[:2], *found.v[:2]], state[:4], rtol=0, atol=1e-10)
        np.testing.assert_allclose(found.q[2:4] - found.q[:2], [1, 0], atol=1e-10)


@pytest.mark.parametrize(
    "name", ["A11_euler_top_generic", "A11_euler_top_dzhanibekov", "A11_euler_top_axis1"]
)
def test_the_free_body_by_quaternion_has_the_exact_attitude_and_spin(name):
    entry = MECHANICS[name]
    inertia, omega0 = entry["params"]["I"], entry["initial"]["omega_body"]
    model = models.free_body_quaternion(inertia, omega0)
    motion = vi.simulate(
        model.system, vi.lobatto(6), q0=[1, 0, 0, 0], v0=model.v0, h=0.02, duration=20.0
    )
    omega = motion.value(models.body_omega(model.system.q, model.system.v))
    exact = entry["reference"]
    for k, time in enumerate(entry["times"]):
        if time <= 20:
            i = round(time / 0.02)
            np.testing.assert_allclose(omega[i], exact["omega"][k], rtol=0, atol=1e-9)
            np.testing.assert_allclose(motion.q[i], exact["quaternion"][k], rtol=0, atol=1e-9)


@pytest.mark.parametrize("rule", [vi.lobatto(2), vi.lobatto(3)], ids=str)
def test_the_free_body_keeps_its_angular_momentum_in_space_and_its_energy_has_no_slope(rule):
    model = models.free_body_quaternion()
    motion = vi.simulate(model.system, rule, q0=model.q0, v0=model.v0, h=0.02, steps=100_000)
    spin = motion.value(model.invariants["angular momentum"])
    assert np.abs(spin - spin[0]).max() <= 1e-11 * np.abs(spin[0]).max()
    windows = motion.energy[1:].reshape(50, -1).mean(axis=1)
    x = np.arange(50) - 24.5
    slope = x @ windows / (x @ x)
    noise = np.std(windows - windows.mean() - slope * x) / np.sqrt(x @ x)
    assert abs(slope) <= 4 * noise + 1e-15
    assert np.ptp(motion.energy) <= (5e-3 if rule.order == 2 else 1e-6)


def test_the_heavy_top_by_quaternion_is_the_heavy_top_by_euler_angles():
    angles = models.heavy_top()
    c = {name: float(value) for name, value in angles.system.defaults.items()}
    turns = [(np.cos(a / 2), np.sin(a / 2)) for a in angles.q0]
    about_z, about_x, about_own = (
        (turns[0][0], 0, 0, turns[0][1]),
        (*turns[1], 0, 0),
        (turns[2][0], 0, 0, turns[2][1]),
    )
    q0 = _product(_product(about_z, about_x), about_own)
    omega = np.array(models.body_rates(ca.DM(angles.q0), ca.DM(angles.v0))).ravel()
    top = models.heavy_top_quaternion([c["I1"], c["I1"], c["I3"]], c["weight"])
    v0 = models.quaternion_rate(q0, omega)
    motion = vi.simulate(top.system, vi.lobatto(6), q0=q0, v0=v0, h=0.005, duration=3.0)
    axis = motion.value(models.rotation(top.system.q))[:, :, 2]
    phi, theta, _ = angles.exact(motion.t)[0].T
    wanted = np.stack(
        [np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi), np.cos(theta)], -1
    )
    np.testing.assert_allclose(axis, wanted, rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.value(top.invariants["spin"]), omega[2], rtol=1e-11)


def _product(a, b):
    (w, x, y, z), (p, q, r, s) = a, b
    return np.array(
        [
            w * p - x * q - y * r - z * s,
            w * q + x * p + y * s - z * r,
            w * r - x * s + y * p + z * q,
            w * s + x * r - y * q + z * p,
        ]
    )


@pytest.mark.parametrize("build", [models.knife_edge, models.rolling_disc])
def test_rolling_models_follow_their_closed_forms_to_second_order(build):
    model = build()
    errors = []
    for h in (model.h, model.h / 2, model.h / 4):
        motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=h, duration=model.duration)
        errors.append(np.abs(motion.q - model.exact(motion.t)[0]).max())
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2, atol=0.05)


def test_the_sleigh_tends_to_a_straight_run_that_uses_all_its_energy():
    model = models.chaplygin_sleigh()
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.01, duration=12.0)
    np.testing.assert_allclose(
        np.hypot(*motion.v[-1, :2]), np.sqrt(2 * motion.energy[0]), rtol=1e-4
    )
    assert abs(motion.v[-1, 2]) <= 1e-4


@pytest.mark.parametrize(
    "build", [models.falling_ladder, models.slide_off_sphere, models.slack_string]
)
def test_contact_models_show_what_they_claim(build):
    model = build()
    motion = vi.simulate(model.system, vi.lobatto(4), **model.start)
    leaves = motion.events[0]
    assert leaves.kind == "detachment"
    there = motion.at(leaves.time)
    cosines = {
        "falling_ladder": (np.sin(there.q[-1]), 2 / 3 * np.sin(model.q0[-1])),
        "slide_off_sphere": (there.q[1], 2 / 3 * model.q0[1]),
        "slack_string": (there.q[1], 2 / 3),
    }
    found, claimed = cosines[model.name]
    assert abs(found - claimed) <= 1e-9


def test_the_double_atwood_machine_has_its_tensions():
    entry = MECHANICS["A06_atwood_double"]["reference"]
    model = models.double_atwood()
    motion = vi.simulate(model.system, **model.start)
    np.testing.assert_allclose(
        -motion.multipliers,
        [[entry["tension_upper"], entry["tension_lower"]]] * len(motion),
        rtol=1e-12,
    )
