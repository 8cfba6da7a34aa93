"""How runs whose steps follow the scene are looked at by the core."""

from __future__ import annotations

import numpy as np

from varint.codegen.cache import CompileError
from varint.codegen.nearness import Nearness, nearness_of
from varint.codegen.rows import as_data
from varint.integration.attempts import SAMPLES
from varint.integration.energy_quantiles import QUANTILES
from varint.integration.error_scale import angles, bodies
from varint.integration.round_off import ROUNDED
from varint.integration.time_transformation.plain_course import level_rows, velocity_rows
from varint.integration.time_transformation.variable_course import MOST_COMPARED
from varint.integration.work_bound import keeps_energy
from varint.scene.memory import per_scene
from varint.scene.system import System


@per_scene
def run_nearness(system: System) -> Nearness | None:
    """How runs are looked at; None where the core cannot."""
    if not system.structure.quadratic_kinetic:
        return None
    energy, velocity = level_rows(system), as_data(velocity_rows(system))
    if energy is None or velocity is None:
        return None
    body = np.arange(system.structure.n)
    for members in bodies(system.names):
        body[members] = members[0]
    turns, parts = np.array(angles(system), dtype=np.int64), np.array(QUANTILES)
    width = len(body) + (1 if keeps_energy(system) else 2)
    how = width, parts, (SAMPLES, MOST_COMPARED), ROUNDED
    try:
        return nearness_of(energy, velocity, body, turns, *how)
    except CompileError:
        return None
