"""Rigid bodies: attitudes and rates meet references and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from model_runs import run
from references import entries

from varint import models

REFERENCE = entries("a")


def quaternion(angles):
    """Unit quaternion (N, 4) of the Euler angles (φ, θ, ψ): q_z(φ) q_x(θ) q_z(ψ), body to space."""
    phi, theta, psi = np.moveaxis(np.asarray(angles), -1, 0) / 2
    c, s = np.cos(theta), np.sin(theta)
    return np.stack(
        [
            c * np.cos(phi + psi),
            s * np.cos(phi - psi),
            s * np.sin(phi - psi),
            c * np.sin(phi + psi),
        ],
        -1,
    )


def product(a, b):
    a0, a1, b0, b1 = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    return np.concatenate(
        [a0 * b0 - (a1 * b1).sum(-1, keepdims=True), a0 * b1 + b0 * a1 + np.cross(a1, b1)], axis=-1
    )


def gap(a, b):
    """Distance of attitudes: q and −q are the same."""
    return np.minimum(np.abs(a - b).max(axis=-1), np.abs(a + b).max(axis=-1)).max()


@pytest.mark.parametrize(
    "name",
    [
        "A11_euler_top_axis1",
        "A11_euler_top_dzhanibekov",
        "A11_euler_top_generic",
        "A11_symmetric_free_top",
    ],
)
def test_attitudes_of_free_bodies_meet_the_reference(name):
    r = REFERENCE[name]
    p = r["params"]
    model = models.free_rigid_body(
        p["I"] if "I" in p else [p["I1"], p["I1"], p["I3"]], r["initial"]["omega_body"]
    )
    attitude = quaternion(model.exact(r["times"])[0])
    # the reference starts at the identity, the model with the angular momentum along z
    start = quaternion(model.q0) * [1, -1, -1, -1]
    assert gap(product(start, attitude), np.array(r["reference"]["quaternion"])) < 2e-12


def test_a_heavy_asymmetric_body_meets_the_reference():
    r = REFERENCE["A11_rigid_body_gnicodes"]
    q0, q1, q2, q3 = r["initial"]["quaternion"]
    plus, minus = np.arctan2(q3, q0), np.arctan2(q2, q1)
    angles = [plus + minus, 2 * np.arctan2(np.hypot(q1, q2), np.hypot(q0, q3)), plus - minus]
    inertia = np.array(r["params"]["I"])
    model = models.heavy_rigid_body(
        inertia, 1.0, angles, np.array(r["initial"]["M_body"]) / inertia
    )
    motion = run(model, h=0.002).at(r["times"][:3])
    values = np.array(r["reference"]["state"])[:3]
    assert gap(quaternion(motion.q), values[:, :4]) < 1e-11
    rates = motion.value(models.body_rates(model.system.q, model.system.v))
    assert np.abs(rates - values[:, 4:]).max() < 1e-11


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (1, 0, 2)])
def test_the_free_bodys_closed_form_holds_for_any_naming_of_the_axes(order):
    order = list(order)
    model = models.free_rigid_body(
        np.array([1.0, 1.7, 2.4])[order], np.array([0.5, 0.3, -0.8])[order]
    )
    motion = run(model, duration=20.0)
    q, v = model.exact(motion.t)
    assert np.abs(motion.q - q).max() < 1e-11
    assert np.abs(motion.v - v).max() < 1e-11
