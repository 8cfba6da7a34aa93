"""Closed paths, and paths of given energy."""

import casadi as ca
import numpy as np
import pytest
from references import given_and_exact
from scenes import pendulum

import varint as vi


def eight(times):
    """A crude figure-eight: sines, three bodies a third of the period apart."""
    phases = [times + k / 3 for k in range(3)]
    return np.stack(
        [x for s in phases for x in (np.sin(2 * np.pi * s), 0.4 * np.sin(4 * np.pi * s))], axis=1
    )


def turned():
    """Each body takes the place of the next."""
    return np.kron(np.roll(np.eye(3), 1, axis=1), np.eye(2))


@pytest.mark.parametrize(
    ("share", "symmetry"), [(1, None), (3, turned())], ids=["whole period", "third of a period"]
)
def test_the_figure_eight_is_found_from_sines_by_its_period_and_by_its_energy(share, symmetry):
    _, exact = given_and_exact("b", "B04_figure_eight")
    scene, rule, steps = vi.models.figure_eight().system, vi.gauss(5), 48 // share
    closed = dict(
        steps=steps, periodic=True, symmetry=symmetry, guess=eight(np.linspace(0, 1 / share, 40))
    )
    orbit = vi.least_action(scene, rule, duration=exact["period"] / share, **closed)
    assert orbit.action * share == pytest.approx(exact["action_one_period"], rel=1e-11)
    assert orbit.energy[0] == pytest.approx(exact["energy"], rel=1e-10)
    level = vi.least_action(scene, rule, energy=exact["energy"], **closed)
    assert level.duration * share == pytest.approx(exact["period"], abs=1e-9)
    for path in (orbit, level):
        again = vi.simulate(scene, rule, q0=path.q[0], p0=path.p[0], h=path.h, steps=share * steps)
        assert np.abs(again.q[-1] - path.q[0]).max() < 1e-9
        assert np.abs(again.p[-1] - path.p[0]).max() < 1e-9
    # Chenciner and Montgomery: least among the choreographies, though not among all closed paths
    assert orbit.is_minimum == (share == 3)


def test_an_oscillation_of_given_energy_has_its_period():
    energy = 0.4 - 1.0  # amplitude: cos θ = 0.6
    motion = vi.least_action(
        pendulum(),
        vi.gauss(6),
        energy=energy,
        steps=30,
        periodic=True,
        guess=np.sin(np.linspace(0, 2 * np.pi, 30))[:, None],
    )
    from varint.models import pendulum_period

    assert motion.duration == pytest.approx(pendulum_period(np.arccos(-energy), 1.0), rel=1e-9)
    assert np.abs(motion.energy - energy).max() < 1e-9


def test_a_rotation_closes_after_a_turn():
    turn = vi.least_action(
        pendulum(),
        vi.gauss(6),
        duration=3.0,
        steps=30,
        periodic=True,
        symmetry=[[1.0, 2 * np.pi]],
        guess=np.linspace(0, 2 * np.pi, 9)[:, None],
    )
    assert turn.q[-1, 0] - turn.q[0, 0] == pytest.approx(2 * np.pi, rel=1e-14)
    assert turn.p[-1, 0] == pytest.approx(turn.p[0, 0], rel=1e-13)
    period = 4 * np.pi / 2 / turn.duration  # mean speed; faster below than above
    assert turn.p.min() < period < turn.p.max()


def test_a_closed_path_stays_closed_on_disk(tmp_path):
    motion = vi.least_action(
        pendulum(),
        vi.gauss(4),
        duration=7.0,
        steps=20,
        periodic=True,
        guess=np.sin(np.linspace(0, 2 * np.pi, 30))[:, None],
    )
    assert np.ptp(motion.q) > 1
    motion.save(tmp_path / "closed.npz")
    again = vi.load(tmp_path / "closed.npz")
    assert (again.closure == motion.closure).all()
    assert again.morse_index == motion.morse_index
    assert motion[:5].closure is None


def test_a_path_of_given_energy_takes_the_time_of_the_thrown_ball():
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])
    speed, angle = 10.0, 1.1  # the high throw
    flight = 2 * speed * np.sin(angle) / 9.81
    far = speed * np.cos(angle) * flight
    path = vi.least_action(
        ball,
        vi.gauss(2),
        q_start=[0, 0],
        q_end=[far, 0],
        energy=speed**2 / 2,
        steps=10,
        duration=vi.free(1.5 * flight, 0.1, 10.0),
    )
    assert path.duration == pytest.approx(flight, rel=1e-12)
    assert path.v[0] == pytest.approx([speed * np.cos(angle), speed * np.sin(angle)], rel=1e-12)
