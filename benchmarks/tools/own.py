"""What of varint is tried in hindsight: rules, steps, time scales and stopping levels."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

import varint as vi
from tools.peers import Setting
from tools.scenes import Scene

RULES = (
    *map(vi.gauss, (4, 6, 8, 10, 16)),
    *map(vi.composition, ("blanes-moan4", "blanes-moan6", "kahan-li8")),
)
GRID = 1.15 ** np.arange(-3, 14)
# a thousandth of it is left
LEVELS = (
    None,
    1e-11,
    1e-10,
    1e-9,
    1e-8,
    1e-7,
    1e-6,
    1e-5,
    1e-4,
    1e-2,
    1e-1,
)
# of encounters, whose steps follow the scene's rate: rules, and radians a step
STAGES = 6, 8, 10
RADIANS = 0.4 * 1.15 ** np.arange(15)


def settings(scene: Scene) -> Iterator[Setting]:
    """Rules, steps and stopping levels of `simulate`; with a time scale where the scene has one."""
    if scene.encounters:
        yield from encounter_settings(scene)
        return
    model = scene.model
    start = {"q0": model.q0, "v0": model.v0, "backend": "compiled", "progress": False}
    for rule in RULES:
        explicit = not rule.points
        if explicit and not model.system.structure.explicit:
            continue
        grid = 2.0 ** np.arange(1, 9) if explicit else GRID * 8 / len(rule.nodes)
        for steps in np.unique(np.round(scene.steps * grid).astype(int)):
            for tol in (None,) if explicit else LEVELS:
                if explicit and steps > 40 * scene.steps and rule.order > 4:
                    continue

                def run(rule=rule, steps=int(steps), tol=tol):
                    motion = vi.simulate(
                        model.system,
                        rule,
                        duration=scene.duration,
                        steps=steps,
                        save_every=steps,
                        iteration_tol=tol,
                        **start,
                    )
                    return np.concatenate([motion.q[-1], motion.p[-1]])

                yield Setting(
                    "varint", f"{rule}, {steps} steps, iteration_tol={tol}", run, 0.0, True
                )
    if scene.scale is not None:
        around = 0.7 if model.name == "kepler" else 1.0
        for stages in (8, 10):
            for per_orbit in (6, 7, 8, 9, 10, 12, 14, 16, 20):
                rule, h = vi.gauss(stages), 2 * np.pi / per_orbit / around
                for tol in (None, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5):

                    def run(rule=rule, h=h, tol=tol):
                        motion = vi.simulate(
                            model.system,
                            rule,
                            h=h,
                            duration=scene.duration,
                            time_scale=scene.scale,
                            save_every=200,
                            iteration_tol=tol,
                            **start,
                        )
                        return np.concatenate([motion.q[-1], motion.p[-1]])

                    steps = f"gauss({stages}), time_scale, h=2π/{per_orbit}/{around}"
                    about = f"{steps}, iteration_tol={tol}"
                    yield Setting("varint", about, run, 0.0, True)


def encounter_settings(scene: Scene) -> Iterator[Setting]:
    """Rules, radians a step and stopping levels of `simulate` with the scene's own time scale."""
    model = scene.model
    start = {"q0": model.q0, "v0": model.v0, "backend": "compiled", "progress": False}
    for stages, h, tol in product(STAGES, RADIANS, LEVELS):

        def run(stages=stages, h=float(h), tol=tol):
            motion = vi.simulate(
                model.system,
                vi.gauss(stages),
                h=h,
                duration=scene.duration,
                time_scale="auto",
                iteration_tol=tol,
                **start,
            )
            return np.concatenate([motion.q[-1], motion.p[-1]])

        about = f"gauss({stages}), time_scale='auto', h={h:.2g}, iteration_tol={tol}"
        yield Setting("varint", about, run, 0.0, True)
