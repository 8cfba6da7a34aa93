"""A small picture for every example of the gallery, the motion itself, and a film where the motion
is the point.

Colours run with time from blue to orange and are seen on light and on dark pages; grey poses stand
at equal times. Drawn anew when the package or this file changes.
"""

from __future__ import annotations

import hashlib
import io
import os
import runpy
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from state import package_state, say

import varint as vi
import varint.multibody as mb

os.environ.setdefault("MPLBACKEND", "Agg")

SIZE, DPI = (2.6, 1.6), 150  # inches: a card is 390 × 240 pixels
FINE = 900  # points of a curve
POSES = 9
COLOURS = ("#0072B2", "#CC79A7", "#E69F00")  # from the beginning to the end
GREY = (0.5, 0.5, 0.5)
VIEW = np.radians(35), np.radians(25)  # azimuth and height from which space is seen
MARGIN = 1.1  # of half the picture
FRAMES = 12  # of a film, a second
MODELS = vi.models
EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass(frozen=True)
class Card:
    """Curves (N, 2) whose colour runs with time, poses as lists of rods (2, 2), dots, and whether
    both axes have one scale.
    """

    curves: list[np.ndarray]
    poses: list[list[np.ndarray]]
    dots: np.ndarray
    equal: bool = True


@dataclass(frozen=True)
class Shown:
    """A motion with what to draw of it, and the time of the motion that a second of film shows; no
    film where that is 0.
    """

    motion: vi.Trajectory
    sketch: vi.Sketch
    speed: float = 0.0


def flat(points: np.ndarray) -> np.ndarray:
    """Places (N, 2) on the picture of places in the plane or in space."""
    if points.shape[1] == 2:
        return points
    (x, y, z), (turn, rise) = points.T, VIEW
    across, away = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
    return np.column_stack([across, z * np.cos(rise) + away * np.sin(rise)])


def moving(shown: Shown) -> Card:
    """Traces, and poses at equal times."""
    motion, sketch = shown.motion, shown.sketch

    def places(times: np.ndarray) -> dict[str, np.ndarray]:
        at = motion.at(times)
        return {name: flat(at.value(where)) for name, where in sketch.points.items()}

    ends = motion.t[0], motion.t[-1]
    fine, few = places(np.linspace(*ends, FINE)), places(np.linspace(*ends, POSES))
    named = sketch.traces or sketch.marks
    poses = [[np.array([few[a][k], few[b][k]]) for a, b in sketch.rods] for k in range(POSES)]
    dots = np.array([few[name][-1] for name in sketch.marks])
    if not sketch.rods:  # bodies at equal times say where it is fast
        dots = np.concatenate([few[name] for name in named]) if len(named) < 3 else dots
    return Card([fine[name] for name in named], poses if sketch.rods else [], dots)


def of(
    model: str, duration: float | None = None, speed: float = 0.0, **numbers: object
) -> Callable[[], Shown]:
    """A ready model, for so long."""

    def make() -> Shown:
        found = getattr(MODELS, model)(**numbers)
        start = dict(q0=found.q0, v0=found.v0, duration=duration or found.duration)
        rule = vi.lobatto(3) if found.system.structure.contacts else None
        step = dict(h=found.h) if rule else {}
        motion = vi.simulate(found.system, rule, **start, **step)
        return Shown(motion, MODELS.sketch(found), speed)

    return make


def optimal(model: str, speed: float = 0.0, leg: int = 0) -> Callable[[], Shown]:
    """A solved model of optimal control."""

    def make() -> Shown:
        found = getattr(MODELS, model)()
        return Shown(found.solve()[leg], MODELS.sketch(found), speed)

    return make


def over_time(model: str, duration: float, **numbers: object) -> Callable[[], Card]:
    """Coordinates over time."""

    def make() -> Card:
        found = getattr(MODELS, model)(**numbers)
        motion = vi.simulate(found.system, q0=found.q0, v0=found.v0, duration=duration)
        t = np.linspace(0, duration, FINE)
        curves = [np.column_stack([t, x]) for x in motion.at(t).q.T]
        return Card(curves, [], np.empty((0, 2)), equal=False)

    return make


def in_phase(model: str, duration: float, **numbers: object) -> Callable[[], Card]:
    """The first coordinate and its velocity."""

    def make() -> Card:
        found = getattr(MODELS, model)(**numbers)
        motion = vi.simulate(found.system, q0=found.q0, v0=found.v0, duration=duration)
        at = motion.at(np.linspace(0, duration, FINE))
        curve = np.column_stack([at.q[:, 0], at.v[:, 0]])
        return Card([curve], [], curve[-1:], equal=False)

    return make


def measured() -> Card:
    """A swing that friction ends, and the coarse angles that tell of it."""
    q, v = vi.coordinates("theta")
    system = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-0.4 * v)
    motion = vi.simulate(system, q0=1.2, v0=0.0, duration=10.0)
    t, few = np.linspace(0, 10, FINE), np.linspace(0.2, 9.8, 40)
    degrees = np.radians(6) * np.round(motion.at(few).q[:, 0] / np.radians(6))
    curve = np.column_stack([t, motion.at(t).q[:, 0]])
    return Card([curve], [], np.column_stack([few, degrees]), equal=False)


def wobble() -> Card:
    """Velocity of a star with two planets, and the days on which it was measured."""
    t = np.linspace(0, 1, FINE)

    def speed(t: np.ndarray) -> np.ndarray:
        return np.cos(11 * t) + 0.3 * np.cos(90 * t) + 0.15 * np.cos(180 * t + 1)

    rng = np.random.default_rng(1)
    few = np.sort(rng.uniform(0, 1, 45))
    dots = np.column_stack([few, speed(few) + 0.15 * rng.normal(size=45)])
    return Card([np.column_stack([t, speed(t)])], [], dots, equal=False)


def tracked() -> Card:
    """The rate of a pole, and what differences of noisy angles say of it."""
    q, v = vi.coordinates("theta")
    motion = vi.simulate(vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q)), q0=2.8, v0=0.0, duration=3.0)
    t, few = np.linspace(0, 3, FINE), np.linspace(0, 3, 50)
    angle = motion.at(few).q[:, 0] + 0.03 * np.random.default_rng(2).normal(size=50)
    curve = np.column_stack([t, motion.at(t).v[:, 0]])
    return Card([curve], [], np.column_stack([few, np.gradient(angle, few)]), equal=False)


def thrown() -> Card:
    """Throws at several angles, the farthest among them."""
    curves, t = [], np.linspace(0, 1, FINE)[:, None]
    for angle in np.radians((15, 30, 45, 60, 75)):
        speed = np.array([np.cos(angle), np.sin(angle)])
        span = 2 * speed[1] * t
        curves.append(span * speed - np.array([0, 0.5]) * span**2)
    return Card(curves, [], np.array([[1.0, 0.0]]))


def let_go() -> Shown:
    """The two-link arm without torques."""
    found = MODELS.two_link_arm()
    start = dict(q0=found.q0, v0=found.v0, u=[0, 0], h=found.h, duration=1.0)
    return Shown(vi.simulate(found.system, **start), MODELS.sketch(found))


def swung_arm() -> Shown:
    """The six-axis arm let go, damped by nothing."""
    arm = mb.from_urdf(EXAMPLES / "six_axis_arm.urdf")
    start = dict(q0=[-0.9, -1.0, 1.2, -1.8, -1.57, 0.0], v0=[3.0, 0, 0, 0, 0, 0])
    return Shown(
        vi.simulate(arm.system(), **start, h=0.01, duration=0.7), mb.skeleton(arm, ["hand"])
    )


def hoisted() -> Shown:
    """The crane's load, and its rope at equal times."""
    world, motion = runpy.run_path(str(EXAMPLES / "crane_and_leap.py"))["crane"]()
    return Shown(motion, mb.skeleton(world, ["load"]), 1.0)


def leapt() -> Shown:
    """The quadruped in the air, its legs let go: what it does without its motors."""
    animal = runpy.run_path(str(EXAMPLES / "quadruped.py"))["quadruped"]()
    motors = {f"{end} swing": 0.2 for end in ("left front", "right front")}
    q0, v0 = mb.start_values(animal, motors, {"trunk": [1.0, 0, 2.5, 0.3, 0, -0.8]})
    start = dict(q0=q0, v0=v0, u=[0] * 8, h=0.01)
    return Shown(vi.simulate(animal.system(), **start, duration=0.5), mb.skeleton(animal), 0.3)


def populations() -> Card:
    found = MODELS.lotka_volterra()
    motion = vi.simulate(found.system, q0=found.q0, v0=found.v0, h=found.h, duration=12.0)
    curve = np.exp(motion.q) if motion.q.min() < 0 else motion.q
    return Card([curve], [], curve[-1:], equal=False)


def soliton() -> Card:
    """Momenta along the chain at a few times, one above the other."""
    found = MODELS.toda_chain()
    motion = vi.simulate(found.system, q0=found.q0, v0=found.v0, h=found.h, duration=found.duration)
    site = np.arange(motion.q.shape[1])
    rise = np.abs(motion.v).max()
    rows = [
        np.column_stack([site, motion.v[k] + 0.7 * rise * j])
        for j, k in enumerate(np.linspace(0, len(motion) - 1, POSES).astype(int))
    ]
    return Card(rows, [], np.empty((0, 2)), equal=False)


def bouncing() -> Card:
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], contact=q[1], restitution=0.85)
    motion = vi.simulate(ball, vi.lobatto(3), q0=[0, 1], v0=[0.8, 0], h=0.01, duration=3.2)
    return Card([motion.q], [], motion.q[:: len(motion) // 24])


def dragged() -> Card:
    q, v = vi.coordinates("x", "y")
    force = -0.03 * v
    scene = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q), force=force)
    motion = vi.simulate(scene, q0=[1, 0], v0=[0, 1.1], duration=24.0)
    return Card([motion.at(np.linspace(0, 24, FINE)).q], [], np.zeros((1, 2)))


def throws() -> Card:
    q, v = vi.coordinates("x", "y")
    ball = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])
    paths = [
        vi.least_action(ball, q_start=[0, 0], q_end=[4, 0], duration=T, steps=40).q
        for T in (0.5, 0.8, 1.0, 1.2)
    ]
    return Card(paths, [], np.array([[0, 0], [4, 0]]))


def windings() -> Card:
    scene = MODELS.pendulum().system
    found = vi.paths(scene, vi.gauss(4), q_start=0.0, q_end=1.0, duration=6.0, steps=120, starts=12)
    curves = [np.column_stack([path.t, path.q[:, 0]]) for path in found[:8]]
    return Card(curves, [], np.empty((0, 2)), equal=False)


def two_ways() -> Card:
    q, v = vi.coordinates("x", "y")
    kepler = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    a, b = np.array([1.0, 0]), np.array([0, 1.5])
    arcs = [
        vi.least_action(kepler, vi.gauss(8), q_start=a, q_end=b, duration=2.0, steps=60, guess=way)
        for way in (None, [a, -(a + b), b])
    ]
    curves = [arc.at(np.linspace(0, 2, 300)).q for arc in arcs]
    return Card(curves, [], np.array([a, b, [0, 0]]))


def round_the_disc() -> Card:
    q, v = vi.coordinates("x", "y")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    ends = dict(q_start=[-2, 0], q_end=[2, 0], duration=1.0, steps=100)
    curves = [
        vi.least_action(
            free,
            vi.midpoint(),
            guess=[[-2, 0], [0, side], [2, 0]],
            bounds=[(1, ca.sumsqr(q), None)],
            **ends,
        ).q
        for side in (1.2, -1.2)
    ]
    turn = np.linspace(0, 2 * np.pi, 90)
    disc = np.column_stack([np.cos(turn), np.sin(turn)])
    rim = [disc[k : k + 2] for k in range(len(disc) - 1)]
    return Card(curves, [rim], np.array([[-2, 0], [2, 0]]))


def fastest() -> Card:
    """The legs in the phase plane: full push, full brake."""
    curves = []
    for leg in MODELS.fastest_transfer().solve():
        at = leg.at(np.linspace(leg.t[0], leg.t[-1], FINE))
        curves.append(np.column_stack([at.q[:, 0], at.v[:, 0]]))
    return Card(curves, [], np.vstack([curve[[0, -1]] for curve in curves]), equal=False)


def unforced() -> Shown:
    """The double pendulum that the acrobot is without its motor."""
    found, steps = MODELS.acrobot(), 250
    system, still = found.system, np.zeros((steps, 1))
    motion = vi.simulate(system, q0=[1.6, 0.6], v0=[0, 0], h=0.01, steps=steps, u=still)
    return Shown(motion, MODELS.sketch(found), 0.5)


def sea() -> Card:
    """The section x = 0 of Hénon–Heiles at E = 1/8, a short line for each crossing."""
    system = MODELS.henon_heiles().system
    y = np.linspace(-0.3, 0.5, 9)
    starts = vi.orbits.starts_at_energy(
        system, 1 / 8, q0=np.column_stack([0 * y, y]), v0=[0, 0], free=system.v[0]
    )
    runs = vi.ensemble(system, vi.gauss(6), **starts, h=0.3, steps=5000)
    points = vi.orbits.poincare_section(runs, system.q[0]).points
    across = np.array([0.004, 0.0])
    ticks = [np.array([p - across, p + across]) for p in points]
    return Card(ticks, [], np.empty((0, 2)), equal=False)


def ascent() -> Card:
    """Height over time under full thrust, then without."""
    q, v = vi.coordinates("height")
    thrust = ca.SX.sym("thrust")
    drag = 310 * v**2 * ca.exp(-500 * (q - 1))
    rocket = vi.System(q, v, v**2 / 2 + 1 / q, force=thrust - drag, control=thrust)
    push = np.where(np.arange(400) < 130, 2.6, 0.0)[:, None]
    motion = vi.simulate(rocket, q0=[1], v0=[0], h=5e-4, steps=400, u=push)
    curve = np.column_stack([motion.t, motion.q[:, 0]])
    return Card([curve], [], curve[[0, 130, -1]], equal=False)


SCENES: dict[str, Callable[[], Shown | Card]] = {
    "pendulum": of("pendulum", 1.6, theta0=2.6),
    "double_pendulum": of("double_pendulum", 8.0, 1.0, theta=(2.2, 2.6)),
    "spherical_pendulum": of("spherical_pendulum", 12.0, 1.5),
    "sliding_bodies": of("sliding_support", 2.2),
    "beads": of("rotating_hoop", 6.0),
    "swinging_atwood": of("swinging_atwood", 16.0, 2.0),
    "kepler": of("kepler", 2 * np.pi, 1.0),
    "central_force": of("rosette", 60.0),
    "many_bodies": of("spring_cluster", 5.0, 1.0),
    "planets": of("solar_system", 4400.0),
    "outer_solar_system": of("outer_solar_system", 60000.0),
    "oscillators": over_time("coupled_oscillators", 70.0),
    "henon_heiles": of("henon_heiles", 60.0),
    "chaos": sea,
    "fpu_chain": over_time("fpu_chain", 12.0),
    "toda_chain": soliton,
    "driven_pendulum": in_phase("driven_pendulum", 40.0),
    "kapitza": of("kapitza_pendulum", 3.0, 0.4),
    "damping": in_phase("caldirola_kanai", 10.0),
    "machines": unforced,
    "rotating_frame": of("turntable", 25.0),
    "charged_particle": of("inverse_distance_field", 40.0),
    "magnetic_mirror": of("magnetic_mirror", 20.0, 3.0),
    "predator_prey": populations,
    "free_body": of("free_rigid_body", 14.0, 2.0),
    "heavy_top": of("heavy_top", 8.0, 1.0),
    "homogeneity_of_space": of("two_body", 40.0),
    "homogeneity_of_time": of("kepler", 2 * np.pi, e=0.8),
    "isotropy": of("rosette", 25.0),
    "galilean_boosts": of("lennard_jones", 3.0),
    "magnetic_translations": of("uniform_fields", 14.0),
    "broken_symmetry": dragged,
    "falling_ladder": of("falling_ladder", None, 0.25),
    "closed_loops": of("four_bar", 0.7, 0.2),
    "atwood_and_wire": of("turning_wire", 2.0),
    "spherical_pendulum_cartesian": of("spherical_pendulum_cartesian", 8.0),
    "rod_chain": of("chain_rods", 1.2, 0.4),
    "linkages": of("andrews_mechanism", 0.03, 0.006),
    "bouncing_balls": bouncing,
    "rolling": of("rolling_disc", 10.0, 1.0),
    "exact_actions": throws,
    "pendulum_paths": windings,
    "lambert": two_ways,
    "geodesics": of("torus_geodesic", 30.0),
    "brachistochrone": of("brachistochrone"),
    "figure_eight": of("figure_eight", None, 1.5),
    "obstacle": round_the_disc,
    "normal_modes": of("spring_pendulum", 7.0, 1.0),
    "halo_orbits": of("restricted_three_body", None, 0.15),
    "arenstorf": of("arenstorf", None, 2.0),
    "control_cart_pole": optimal("swing_up_cart_pole", 0.6),
    "control_minima": optimal("swing_up_pendulum", 0.8),
    "control_fastest": fastest,
    "control_rocket": ascent,
    "control_machines": optimal("overhead_crane", 1.0),
    "control_films": optimal("falling_cat", 0.3),
    "mpc_cart_pole": optimal("swing_up_rod"),
    "six_axis_arm": swung_arm,
    "crane_and_leap": hoisted,
    "quadruped": leapt,
    "two_link_arm_in_c": let_go,
    "learnt_from_data": measured,
    "exoplanets": wobble,
    "solar_system_masses": of("outer_solar_system", 30000.0),
    "estimated_cart_pole": tracked,
    "design_parameters": thrown,
}


def png(card: Card) -> bytes:
    """The card's picture, in few colours and without a ground of its own."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from PIL import Image

    by_time = LinearSegmentedColormap.from_list("time", COLOURS)
    figure = Figure(figsize=SIZE, dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for k, rods in enumerate(card.poses):
        last = k == len(card.poses) - 1
        shade = 0.9 if last else 0.2 + 0.4 * k / len(card.poses)
        lines = LineCollection(rods, colors=[(*GREY, shade)], linewidths=2.2 if last else 1.2)
        axes.add_collection(lines)
    width = 2.0 if len(card.curves) < 4 else 1.1
    for curve in card.curves:
        pieces = np.stack([curve[:-1], curve[1:]], axis=1)
        lines = LineCollection(pieces, cmap=by_time, linewidths=width, capstyle="round")
        lines.set_array(np.linspace(0, 1, len(pieces)))
        axes.add_collection(lines)
    if len(card.dots):
        axes.plot(*card.dots.T, "o", ms=4.5, color=COLOURS[2], mec="none")
    every = [*card.curves, card.dots.reshape(-1, 2), *(rod for pose in card.poses for rod in pose)]
    low, high = np.vstack(every).min(axis=0), np.vstack(every).max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9 * np.ptp(high - low))
    if card.equal:
        half = max(half[0] / SIZE[0], half[1] / SIZE[1]) * np.array(SIZE)
    axes.set(xlim=middle[0] + MARGIN * half[:1] * [-1, 1])
    axes.set(ylim=middle[1] + MARGIN * half[1:] * [-1, 1])
    raw, small = io.BytesIO(), io.BytesIO()
    figure.savefig(raw, transparent=True)
    picture = Image.open(raw).quantize(96, method=Image.Quantize.FASTOCTREE, dither=0)
    picture.save(small, format="PNG", optimize=True)
    return small.getvalue()


def film(shown: Shown, path: Path) -> None:
    """The motion at its speed."""
    shown.motion.animate(path, sketch=shown.sketch, speed=shown.speed, fps=FRAMES)


def draw(name: str, folder: Path) -> None:
    """The card of an example, and its film if it has one."""
    scene = SCENES[name]()
    card = moving(scene) if isinstance(scene, Shown) else scene
    (folder / f"{name}-card.png").write_bytes(png(card))
    if isinstance(scene, Shown) and scene.speed:
        film(scene, folder / f"{name}-film.gif")
    (folder / f".{name}-card.state").write_text(state())


def state() -> str:
    """A digest of all that cards depend on."""
    return hashlib.sha256(Path(__file__).read_bytes() + package_state().encode()).hexdigest()


def is_kept(name: str, folder: Path) -> bool:
    """Whether the example's card is of this state."""
    kept = folder / f".{name}-card.state"
    return kept.exists() and kept.read_text() == state()


if __name__ == "__main__":  # python cards.py FOLDER NAME …, in a process of its own
    for asked in sys.argv[2:]:
        began = time.perf_counter()
        draw(asked, Path(sys.argv[1]))
        say(f"drew the card of {asked} in {time.perf_counter() - began:.1f} s")
