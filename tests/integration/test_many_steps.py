"""Dense output by the scene's own loop agrees with CasADi's interpreter."""

from __future__ import annotations

import numpy as np
import pytest

import varint as vi

SCENES = {
    "explicit": ("henon_heiles", vi.composition("blanes-moan4"), 0.1),
    "stages": ("double_pendulum", vi.gauss(4), 0.05),
    "constraints": ("pendulum_cartesian", vi.lobatto(4), 0.05),
    "rattle": ("pendulum_cartesian", vi.lobatto(2), 0.02),
    "parameters and time": ("driven_pendulum", vi.gauss(2), 0.05),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_motion_between_nodes_is_the_same_by_loop_and_interpreter(name):
    model, rule, h = SCENES[name]
    scene = getattr(vi.models, model)()
    start = dict(q0=scene.q0, v0=scene.v0, h=h, steps=12, save_every=4)
    times = np.random.default_rng(0).uniform(0, 12 * h, 40)
    found, reference = (
        vi.simulate(scene.system, rule, **start, backend=backend).at(times)
        for backend in ("auto", "interpreted")
    )
    assert np.abs(found.q - reference.q).max() < 1e-12 * max(1, np.abs(reference.q).max())
    assert np.abs(found.p - reference.p).max() < 1e-12 * max(1, np.abs(reference.p).max())


def test_between_the_nodes_of_an_automatic_time_scale_energy_is_kept():
    """Seven bodies: a hundred times are a hundred Newton steps of 120 unknowns."""
    model = vi.models.pleiades()
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=3.0)
    between = motion.at(np.linspace(0, 3, 101))
    assert np.abs(between.energy / motion.energy[0] - 1).max() < 1e-9
