"""What derivatives by loops in C are compared with."""

from __future__ import annotations

import numpy as np

import varint as vi


def assert_as_step_after_step(motion, loss, wrt):
    """Gradient and tangents by the loops of the core are those of CasADi's, step after step."""
    system = motion.system
    data, other = (
        vi.gradient(motion, loss, system.q[1], nodes=system.v[0] ** 2, backend=backend)
        for backend in ("native", "interpreted")
    )
    for name in ("value", "q0", "v0", "p0", "u", "h", "t0"):
        one, two = getattr(data, name), getattr(other, name)
        assert np.allclose(one, two, rtol=1e-13, atol=1e-13), name
    for name, x in data.params.items():
        assert np.allclose(x, other.params[name], rtol=1e-13, atol=1e-13)
    one, two = (vi.sensitivity(motion, wrt, backend=x) for x in ("native", "interpreted"))
    assert np.abs(one - two).max() < 1e-13 * np.abs(two).max()
