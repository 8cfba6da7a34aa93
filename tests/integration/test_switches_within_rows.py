"""Controls that vary within the rows of their table beside forces that jump: steps end at the
switches, and u(t) acts between them as any other force of time.
"""

import casadi as ca
import numpy as np
import pytest

import varint as vi

CLOSE = dict(rel=1e-9, abs=1e-9)


def sled(friction, wall=None):
    q, v = vi.coordinates("x")
    u = ca.SX.sym("u")
    gap = None if wall is None else wall - q
    return vi.System(q, v, v**2 / 2, force=u - friction * ca.sign(v), control=u, contact=gap)


def table(signal, rows, duration, nodes):
    """Values of a signal at the nodes of a rule in every row, (rows, nodes, 1)."""
    t = (np.arange(rows)[:, None] + np.array(nodes)) * duration / rows
    return signal(t)[:, :, None]


def push(t):
    """Up to 2 and down to −4, in straight lines."""
    return np.where(t <= 1, 2 * t, 2 - 2 * (t - 1))


def way(t):
    """From rest under dry friction 1: off at 1/2, at rest again where the speed is zero."""
    s = min(t, 1.0) - 0.5
    x, v = s**3 / 3, s**2
    r = t - 1
    # dv/dt = 1 − 2 r
    stop = 0.5 + np.sqrt(0.25 + 0.25)
    r = min(max(r, 0.0), stop)
    x += 0.25 * r + r**2 / 2 - r**3 / 3 if t > 1 else 0.0
    return x, (0.25 + r - r**2 if t > 1 else v)


@pytest.mark.parametrize("rows", [4, 40])
def test_a_sled_is_pushed_off_its_friction_and_held_by_it_again(rows):
    scene, duration = sled(1.0), 2.0
    u = table(push, rows, duration, vi.gauss(2).nodes)
    motion = vi.simulate(scene, q0=0.0, v0=0.0, duration=duration, u=u)
    for t in (0.25, 0.75, 1.0, 1.5, 2.0):
        expected = way(t) if t > 0.5 else (0.0, 0.0)
        there = motion.at(t)
        assert (there.q.item(), there.v.item()) == pytest.approx(expected, **CLOSE)
        assert motion.at([t]).u.item() == pytest.approx(push(t))
    assert motion.stats["error_estimate"] < 1e-12
    assert len(motion) < 100 * rows
    assert vi.simulate(scene, q0=0.0, v0=0.0, duration=duration, u=u, tol=1e-6).q[
        -1
    ] == pytest.approx(motion.q[-1], **CLOSE)


def test_what_controls_do_within_rows_is_what_a_force_of_time_does(tmp_path):
    """sin t as a polynomial in each row, beside dry friction that sticks and slips."""
    q, v = vi.coordinates("x")
    t, u, c = vi.time(), ca.SX.sym("u"), 0.4
    lagrangian = v**2 / 2 - q**2 / 8
    scene = vi.System(q, v, lagrangian, force=u - c * ca.sign(v), control=u)
    duration, rows, rule = 9.0, 12, vi.gauss(6)
    values = table(np.sin, rows, duration, rule.nodes)
    given = dict(q0=1.0, v0=0.0, duration=duration)
    motion = vi.simulate(scene, rule, u=values, **given)
    forced = vi.simulate(
        vi.System(q, v, lagrangian, force=ca.sin(t) - c * ca.sign(v), t=t), **given
    )
    times = np.linspace(0, duration, 19)
    # the polynomials of six nodes are within 1e-9 of sin t
    assert motion.at(times).q == pytest.approx(forced.at(times).q, abs=3e-9)
    assert motion.at(times).u[:, 0, 0] == pytest.approx(np.sin(times), abs=1e-6)
    held = np.abs(motion.v[:, 0]) < 1e-14
    assert held.sum() > 4 and not held.all()
    motion.save(tmp_path / "motion")
    loaded = vi.load(tmp_path / "motion")
    assert np.array_equal(loaded.at(times).q, motion.at(times).q)
    assert np.array_equal(loaded.u, motion.u)
    kept = [
        vi.simulate(scene, rule, u=values, checkpoint=tmp_path / "run", **given) for _ in range(2)
    ]
    assert np.array_equal(kept[0].q, kept[1].q) and np.array_equal(kept[0].u, kept[1].u)


def test_controls_within_rows_push_a_sled_off_a_wall():
    """Held by the wall as long as u < 1, by friction 1 until u = −1, and pulled away from there."""
    u = table(lambda t: 2 - 2 * t, 4, 2.5, vi.lobatto(3).nodes)
    motion = vi.simulate(sled(1.0, wall=1.0), q0=1.0, v0=0.0, duration=2.5, u=u)
    assert motion.at(1.4).q.item() == pytest.approx(1, abs=1e-14)
    s = 2.5 - 1.5  # from u = −1 on dv/dt = −2 s
    assert motion.q[-1].item() == pytest.approx(1 - s**3 / 3, **CLOSE)
    assert motion.v[-1].item() == pytest.approx(-(s**2), **CLOSE)
