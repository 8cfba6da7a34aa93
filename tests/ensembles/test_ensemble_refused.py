"""Wrong ensembles are refused before a member moves."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from ensemble_scenes import falling, pushed, swinging
from scenes import double_pendulum

import varint as vi


def test_wrong_ensembles_are_refused_at_once():
    system, grid = swinging(), dict(h=0.1, steps=5)
    with pytest.raises(vi.InputError, match="no argument has a leading axis"):
        vi.ensemble(system, q0=0.1, v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=r"numbers of members differ: \{'q0': 3, 'length': 4\}"):
        vi.ensemble(system, q0=[1, 2, 3], v0=0.0, params=dict(length=[1, 2, 3, 4]), **grid)
    with pytest.raises(vi.InputError, match=r"q0 is not finite in members \[1\]"):
        vi.ensemble(system, q0=[1, np.nan, 3], v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=r"q0 has shape \(3, 3\); it must be \(2,\)"):
        vi.ensemble(double_pendulum(), q0=np.eye(3), v0=[0, 0], **grid)
    with pytest.raises(vi.InputError, match=r"unknown parameters \['lenght'\]"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, params=dict(lenght=1.0), **grid)
    with pytest.raises(
        vi.InputError, match=r"mass matrix .* singular at the start of members \[2\]"
    ):
        vi.ensemble(system, q0=0.1, v0=0.0, params=dict(length=[1.0, 2.0, 0.0]), **grid)
    with pytest.raises(vi.InputError, match=r"not finite at the start of members \[0, 3\]"):
        vi.ensemble(falling(), q0=[-1.0, 1.0, 2.0, -3.0], v0=0.0, **grid)
    with pytest.raises(vi.InputError, match="must have a submit method"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, executor=4, **grid)
    with pytest.raises(vi.InputError, match="give two of h, steps, duration"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, h=0.1)
    with pytest.raises(vi.InputError, match="give v0 or p0, not both"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, p0=0.0, **grid)
    with pytest.raises(vi.InputError, match="unknown backend 'fast'"):
        vi.ensemble(system, q0=[1, 2], v0=0.0, backend="fast", **grid)
    with pytest.raises(vi.VarintError, match="members are compiled together for compositions"):
        vi.ensemble(
            pushed(),
            vi.lobatto(3),
            q0=[[0, 0], [1, 1]],
            v0=[0, 0],
            u=1.0,
            backend="compiled",
            **grid,
        )
    with pytest.raises(vi.InputError, match="may be one table"):
        vi.ensemble(
            pushed(), vi.gauss(2), q0=[0, 0], v0=[0, 0], u=np.zeros((2, 2, 1)), h=0.1, steps=2
        )


@pytest.mark.parametrize("wrong", ["q0", "v0", "gap"])
def test_a_bad_start_of_any_member_is_refused_before_one_moves(wrong, monkeypatch):
    from varint.ensembles import executor

    def never(*arguments):
        raise AssertionError("a member was stepped")

    monkeypatch.setattr(executor, "step_chunk", never)
    q, v = vi.coordinates("x", "y")
    held = dict(contact=q[1]) if wrong == "gap" else dict(constraint=ca.sumsqr(q) - 1)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], **held)
    angles = np.linspace(0.1, 3, 50)
    q0, v0 = np.stack([np.cos(angles), np.sin(angles)], axis=1), np.zeros((50, 2))
    if wrong == "v0":
        v0[37] = q0[37]
    else:
        q0[37] *= -2
    with pytest.raises(vi.InputError, match=r"member 37: (q0|v0) violates"):
        vi.ensemble(system, q0=q0, v0=v0, h=0.01, steps=10)
