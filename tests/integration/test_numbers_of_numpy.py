"""Numbers of NumPy, as a grid of settings has them, go the ways that Python's own go."""

import numpy as np
import pytest

import varint as vi
from varint.integration import simulate as module

CALLS = {
    "by steps": (vi.models.pendulum(), dict(h=0.01, duration=0.02)),
    "to a tolerance": (vi.models.pendulum(), dict(duration=1.0, tol=1e-6)),
    "by default, from another time": (vi.models.kepler(), dict(duration=2.0, t0=1.5)),
    "with a time scale": (
        vi.models.arenstorf(),
        dict(rule=vi.gauss(8), time_scale="auto", h=1.6, duration=17.0, iteration_tol=1e-6),
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_numbers_of_numpy_go_the_short_ways(name, monkeypatch):
    """The long ones took five times the time, and as many evaluations with a time scale."""
    model, how = CALLS[name]
    start = dict(q0=model.q0, v0=model.v0)
    own = vi.simulate(model.system, **start, **how)
    numbers = {k: np.float64(x) if isinstance(x, float) else x for k, x in how.items()}
    monkeypatch.setattr(module, "simulate_steps", None)  # the ways of all other calls
    monkeypatch.setattr(module, "_to_tolerance", None)
    found = vi.simulate(model.system, **start, **numbers)
    for x in ("t", "q", "p"):
        assert getattr(found, x).tobytes() == getattr(own, x).tobytes()
    assert type(found.t[0]) is type(own.t[0])
