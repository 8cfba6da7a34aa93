"""Where a scene of the benchmarks ends, to more digits than any tool is asked for."""

from typing import Any

import numpy as np

import varint as vi
from tools.heyoka_peer import taylor
from tools.scenes import Scene


def reference(scene: Scene):
    """q at the end in closed form, or by order 32 (24 through encounters) with many steps; and how
    far heyoka's tightest run is from it.
    """
    model = scene.model
    if model.exact:
        exact = model.exact(scene.duration)[0][0]
    else:
        how: dict[str, Any] = dict(rule=vi.gauss(12), h=0.25, time_scale="auto")
        if not scene.encounters:
            steps = 4 * scene.steps
            how = dict(rule=vi.gauss(16), steps=steps, save_every=steps, backend="compiled")
        start = dict(q0=model.q0, v0=model.v0, duration=scene.duration)
        exact = vi.simulate(model.system, **start, **how, progress=False).q[-1]
    if scene.slow:
        return exact, float("nan")
    other = taylor(model.system, "velocities", 1e-18)
    other.state[:] = np.concatenate([model.q0, model.v0])
    other.propagate_until(scene.duration)
    return exact, float(np.abs(other.state[: len(exact)] - exact).max())
