"""A motion whose steps differ in size, by operations as data and by compiled ones."""

from __future__ import annotations

import varint as vi
from varint.codegen.gauss import gauss_kernel
from varint.codegen.native import native_gauss
from varint.integration import short_trials
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.small_motions import small_motions_at_start


def require_same_bytes(monkeypatch, scene, q0, v0, duration, tol, radians):
    """The motion that gauss(8) has for this tolerance is the same in both gears."""
    rule = vi.gauss(8)
    start, options = Start(q0, v0), RunOptions(steps=1, duration=duration)
    problem = initial_value_problem(scene, rule, start, options)
    mass = small_motions_at_start(scene, problem.q0, problem.p0, problem.t0, problem.c)[1]
    asked = scene, rule, problem, mass, tol, (radians, radians), "auto", 0.0
    found = []
    for kernel in (native_gauss(scene, rule), gauss_kernel(scene, rule)):
        monkeypatch.setattr(short_trials, "kernel_for", lambda *_, kernel=kernel: kernel)
        found.append(short_trials.by_short_trials(*asked, grows=True))
    one, other = (choice.motion for choice in found)
    assert one.sizes is not None
    for name in ("t", "q", "p", "v", "sizes"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert found[0].estimate == found[1].estimate
