"""How many links and motors a machine may have before anything has to be compiled for it."""

from __future__ import annotations

import numpy as np
import pytest

import varint as vi
import varint.multibody as mb
from varint.codegen import frozen
from varint.codegen.gauss import gauss_scheme
from varint.integration import gears
from varint.numerics import progress

AXES = ((0, 1, 0), (1, 0, 0), (0, 0, 1))


def branched(links: int) -> mb.Model:
    """Each link carries two others."""
    world, names = mb.Model(gravity=(0, 0, 0)), ["world"]
    for i in range(links):
        names.append(world.body(1.0, (0.05, 0.02, -0.5), (0.1, 0.12, 0.05), f"link{i}").name)
        parent = (i - 1) // 2 + 1 if i else 0
        world.revolute(names[parent], names[-1], AXES[i % 3], (0, 0, -1 if parent else 0))
    return world


def test_a_machine_of_many_motors_runs_as_data():
    world, motors = mb.Model(), 20
    for i in range(motors):
        world.revolute(world, world.body(1.0, (0, 0, -0.5), 0.1, f"rod{i}"), (0, 1, 0))
        world.motor(f"rod{i}")
    scene = world.system()
    torques = np.sin(np.arange(5 * 2 * motors)).reshape(5, 2, motors)
    run = {"q0": 0.1 * np.arange(motors), "v0": np.zeros(motors), "h": 0.01, "steps": 5}
    native, exact = (
        vi.simulate(scene, vi.gauss(2), **run, u=torques, backend=backend)
        for backend in ("native", "interpreted")
    )
    assert abs(native.q - exact.q).max() <= 1e-15
    assert abs(native.q[-1] - native.q[0]).max() > 1e-3
    # the compiler's source is made of what the data were made of
    assert gauss_scheme(scene, 2) is gauss_scheme(scene, 2, gauss_scheme(scene, 2).form)


def test_the_plan_of_a_machine_says_what_its_loop_in_c_does(monkeypatch):
    few, many = str(vi.plan(branched(3).system())), str(vi.plan(branched(24).system()))
    assert "no matrix; Newton's method where that fails" in few and "no matrix\n" in many
    monkeypatch.setattr(frozen, "LARGE_TREE", 2)
    world = branched(2)
    world.spring("link0", "link1", stiffness=1.0)
    assert "stiffness and damping in the middle of the step" in str(vi.plan(world.system()))


@pytest.mark.long
def test_two_hundred_links_run_as_data():
    links = np.arange(200)
    scene = branched(len(links)).system()
    start = {"q0": 0.3 * np.cos(links), "v0": 0.05 * np.sin(links)}
    motion = vi.simulate(scene, vi.gauss(2), **start, h=2e-3, steps=100, backend="native")
    assert motion.stats["iterations"] <= 8 * 100
    assert np.ptp(motion.energy) <= 1e-12 * abs(motion.energy[0])


def test_setting_up_many_links_is_said_where_someone_watches(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_is_watched", lambda: True)
    monkeypatch.setattr(progress, "SILENCE", 1e-3)
    monkeypatch.setattr(gears, "MANY", 12)
    scene = branched(12).system()
    vi.simulate(scene, vi.gauss(1), q0=np.zeros(12), v0=np.ones(12), h=1e-3, steps=1)
    assert "arranging the operations of 12 coordinates" in capsys.readouterr().err
