"""Ready scenes simulated by a rule whose error is below round-off."""

from __future__ import annotations

import varint as vi

FINE = vi.gauss(6)


def run(model: vi.models.Model, rule: vi.Rule = FINE, **changes) -> vi.Trajectory:
    """The model from its own start, some of its arguments changed."""
    return vi.simulate(model.system, rule, **model.start | changes)
