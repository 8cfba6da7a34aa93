"""The scenes of the work–precision benchmark: a system, its start, how long, and what the peers
should know of it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

import varint as vi
from varint.models.model import Model


@dataclass(frozen=True)
class Scene:
    """One scene of the benchmark.

    Attributes
    ----------
    model : Model
        System and start.
    duration : float
    steps : int
        Steps of gauss(8) that reach about 1e-9.
    scale : SX or None
        A time scale to try as well.
    bodies : tuple or None
        (masses, G) where REBOUND can run it.
    slow : bool
        Leave out the tools that need minutes for it.
    encounters, forced, long : bool
    """

    model: Model
    duration: float
    steps: int
    scale: ca.SX | None = None
    bodies: tuple | None = None
    slow: bool = False
    # close encounters: steps follow the scene's own rate, and equal ones are not tried
    encounters: bool = False
    # forces or explicit time, which most of the tools here are not told of
    forced: bool = False
    # repeats another one for longer: the slowest tools need not show what they do again
    long: bool = False


def kepler(e: float, steps: int) -> Scene:
    model = vi.models.kepler(e=e)
    return Scene(
        model, 200 * np.pi, steps, vi.close_encounters(ca.norm_2(model.system.q)), ([1.0, 0.0], 1.0)
    )


def solar_system() -> Scene:
    model = vi.models.outer_solar_system()
    defaults = model.system.defaults
    return Scene(model, 2e5, 150, bodies=(defaults["m"], float(defaults["G"])))


def encounters(model: Model, duration: float = 0.0) -> Scene:
    """A scene of close encounters; of bodies that attract each other with REBOUND, too."""
    masses = model.system.defaults.get("m")
    bodies = (masses, 1.0) if masses is not None else None
    return Scene(model, duration or model.duration, 0, bodies=bodies, encounters=True)


def polar_passage() -> Scene:
    """A perturbed Kepler problem in polar coordinates that comes near the centre."""
    q, v = vi.coordinates("r", "phi")
    kinetic = v[0] ** 2 / 2 + q[0] ** 2 * v[1] ** 2 / 2
    model = Model(
        name="polar_passage",
        system=vi.System(q, v, kinetic + 1 / q[0] - 0.01 * q[0] ** 2),
        q0=[1.5, 0.0],
        v0=[0.0, 0.15],
        duration=400.0,
        h=0.01,
        claim="An orbit that turns by itself, in polar coordinates.",
        source="",
    )
    return encounters(model)


def forced(
    name: str, system: vi.System, q0: list, v0: list, duration: float, steps: int, claim: str
) -> Scene:
    """A scene whose energy tells nothing of errors: forces, or explicit time."""
    model = Model(
        name=name, system=system, q0=q0, v0=v0, duration=duration, h=0.01, claim=claim, source=""
    )
    return Scene(model, duration, steps, forced=True)


def drag() -> Scene:
    q, v = vi.coordinates("x", "y", "z")
    system = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[2], force=-0.05 * ca.norm_2(v) * v)
    claim = "A projectile slowed by the square of its speed."
    return forced("drag", system, [0.0, 0.0, 1.0], [20.0, 3.0, 15.0], 3.0, 20, claim)


def van_der_pol() -> Scene:
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=2.0 * (1 - q**2) * v)
    return forced("van_der_pol", system, [0.5], [0.0], 20.0, 300, "Relaxation to a limit cycle.")


def duffing() -> Scene:
    (q, v), t = vi.coordinates("x"), vi.time()
    push = -0.1 * v + 0.3 * ca.cos(1.2 * t)
    system = vi.System(q, v, v**2 / 2 + q**2 / 2 - q**4 / 4, force=push, t=t)
    return forced("duffing", system, [1.0], [0.0], 50.0, 300, "A driven, damped double well.")


def growing_mass() -> Scene:
    (q, v), t = vi.coordinates("x", "y"), vi.time()
    spring = ca.sumsqr(q) / 2 + 0.3 * q[0] ** 2 * q[1]
    system = vi.System(q, v, (1 + 0.1 * t) * ca.sumsqr(v) / 2 - spring, t=t)
    claim = "A mass that grows in an anharmonic well."
    return forced("growing_mass", system, [0.5, 0.2], [0.0, 0.6], 30.0, 60, claim)


def falling_orbit() -> Scene:
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), force=-0.001 * v)
    start = [0.03, 0.0], [0.0, (1.97 / 0.03) ** 0.5]  # at pericentre, e = 0.97
    return forced("falling_orbit", system, *start, 20.0, 8000, "A comet that drag slows down.")


def chain(links: int, steps: int) -> Scene:
    """Links of unit mass and length as angles, released from rest: a slight zigzag half a radian
    off the vertical.
    """
    q, v = vi.coordinates(*(f"a{i}" for i in range(links)))
    speed, height, energy = ca.SX.zeros(2), ca.SX(0), ca.SX(0)
    for i in range(links):
        speed += v[i] * ca.vertcat(ca.cos(q[i]), ca.sin(q[i]))
        height -= ca.cos(q[i])
        energy += ca.sumsqr(speed) / 2 - 9.81 * height
    system = vi.System(q, v, energy)
    start = 0.5 + 0.1 * (-1.0) ** np.arange(links)
    model = Model(
        name=f"chain_{links}",
        system=system,
        q0=start,
        v0=np.zeros(links),
        duration=1.0,
        h=0.01,
        claim="A hanging chain of links of unit length and mass.",
        source="",
    )
    return Scene(model, 1.0, steps, slow=True)


def longer(scene: Scene, factor: int) -> Scene:
    """The same motion for longer, so that a run takes milliseconds and what a call costs besides
    does not count.
    """
    return replace(scene, duration=scene.duration * factor, steps=scene.steps * factor, long=True)


SCENES: dict[str, Callable[[], Scene]] = {
    "pendulum": lambda: Scene(vi.models.pendulum(2.0, g=1.0), 100.0, 70),
    "kepler 0.6": lambda: kepler(0.6, 2000),
    "kepler 0.9": lambda: kepler(0.9, 10_000),
    "henon-heiles": lambda: Scene(vi.models.henon_heiles(), 1000.0, 500),
    "double pendulum": lambda: Scene(vi.models.double_pendulum(), 10.0, 40),
    "solar system": solar_system,
    "spherical pendulum": lambda: Scene(vi.models.spherical_pendulum(), 100.0, 150),
    "pendulum on a cart": lambda: Scene(vi.models.sliding_support(), 100.0, 250),
    "charged particle": lambda: Scene(vi.models.inverse_distance_field(), 200.0, 150),
    "arenstorf": lambda: encounters(vi.models.arenstorf()),
    "pleiades": lambda: encounters(vi.models.pleiades()),
    "pythagorean": lambda: encounters(vi.models.pythagorean_three_body()),
    "kepler 0.99": lambda: replace(
        encounters(vi.models.kepler(e=0.99), 20 * np.pi), bodies=([1.0, 0.0], 1.0)
    ),
    "polar passage": polar_passage,
    "fpu": lambda: Scene(vi.models.fpu_chain(), 200.0, 3000),
    "chain of 10": lambda: chain(10, 13),
    "chain of 30": lambda: chain(30, 24),
    "chain of 50": lambda: chain(50, 32),
}
LONGER = {
    "pendulum": 200,
    "kepler 0.6": 10,
    "kepler 0.9": 5,
    "henon-heiles": 20,
    "double pendulum": 100,
    "solar system": 10,
    "spherical pendulum": 20,
    "pendulum on a cart": 30,
    "charged particle": 100,
    "chain of 10": 5,
    "chain of 30": 5,
}
SCENES = {
    f"{name} ×{by}": (lambda f=SCENES[name], by=by: longer(f(), by)) for name, by in LONGER.items()
} | SCENES
FORCED: dict[str, Callable[[], Scene]] = {
    "projectile with drag": drag,
    "van der pol": van_der_pol,
    "driven duffing": duffing,
    "growing mass": growing_mass,
    "kepler 0.97 with drag": falling_orbit,
}
