"""Turning frames show the motion of the inertial frame, turned back."""

from __future__ import annotations

import numpy as np
from model_runs import run

from varint import models


def test_a_spring_seen_from_a_turning_frame_is_the_spring_of_the_inertial_frame():
    Omega, stiffness = np.array([0.3, -0.2, 0.9]), 1.69
    seen = models.rotating_frame(Omega=Omega, stiffness=stiffness)
    inertial = models.isotropic_oscillator(seen.q0, seen.v0 + np.cross(Omega, seen.q0), omega=1.3)
    a, b = run(seen), run(inertial, h=seen.h, duration=seen.duration)
    back = models.rotating.turned(a.q, Omega / np.linalg.norm(Omega), np.linalg.norm(Omega) * a.t)
    assert np.abs(back - b.q).max() < 1e-12
    # the momentum of the turning frame is the inertial one
    assert (
        np.abs(
            models.rotating.turned(a.p, Omega / np.linalg.norm(Omega), np.linalg.norm(Omega) * a.t)
            - b.p
        ).max()
        < 1e-12
    )


def test_the_turntable_is_the_frame_turning_about_z():
    flat = models.turntable()
    space = models.rotating_frame(q0=[*flat.q0, 0], v0=[*flat.v0, 0], Omega=(0, 0, 0.7))
    turned = run(space, h=flat.h, duration=flat.duration)
    # a constant map of rounded numbers errs by 1e-16 of 30 m in each of 1,250 steps
    assert np.abs(run(flat).q - turned.q[:, :2]).max() < 1e-11


def test_foucaults_plane_of_swing_turns_against_the_frame_at_its_rate():
    # started at the rate −Ω about the vertical, the bob swings in a plane of the inertial frame
    turning = run(
        models.foucault_pendulum(latitude=np.pi / 2, Omega=5e-3, v0=(0.0, -3.0 * 5e-3)),
        duration=400.0,
    )
    angle = np.arctan2(turning.q[:, 1], turning.q[:, 0])
    swing = np.mod(angle + 5e-3 * turning.t + np.pi / 2, np.pi) - np.pi / 2
    assert np.abs(swing[np.hypot(*turning.q.T) > 0.1]).max() < 1e-11
