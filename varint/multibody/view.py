"""Machines to look at: where their shapes are along a motion, films and pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.drawing.animation import extent, film_interval, frame_times
from varint.drawing.body_film import body_film
from varint.drawing.body_page import write_body_page
from varint.drawing.sketch import Sketch
from varint.drawing.surfaces import MovingBody, Surface, box_corners, primitive
from varint.errors import InputError
from varint.multibody.data import WORLD
from varint.multibody.mesh import can_read, surface
from varint.multibody.model import Model
from varint.multibody.rotations import frame_along
from varint.multibody.shapes import GREY, Shape
from varint.results.require import require_trajectory
from varint.results.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

STICK = 0.02  # thickness of the rods that stand for bodies without shapes, of the machine's size
ARM = 0.1  # length of a frame's axes, of half the machine's size
SMALLEST = 1e-3  # of a machine whose bodies all begin in one point
MOST_FACES = 5_000  # triangles of a mesh; one with more is drawn as its convex hull


def animate(
    model: Model,
    motion: Trajectory,
    path: Any = None,
    *,
    speed: float = 1.0,
    fps: float = 25.0,
    frames: Sequence[str] = (),
    traces: Sequence[str] = (),
) -> FuncAnimation:
    """A film of a machine in space, at a speed true to time.

    Parameters
    ----------
    model : Model
    motion : Trajectory
        Of its system.
    path : path, optional
        Where to write it: .gif, .html (pictures inside) or .mp4.
    speed : float, optional
        Time of the motion per second of film.
    fps : float, optional
    frames : sequence of str, optional
        Bodies and markers whose axes are drawn (x red, y green, z blue).
    traces : sequence of str, optional
        Bodies and markers whose path is drawn.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Notebooks show it. Bodies without shapes are rods between their joints.

    Raises
    ------
    InputError
        If the motion is not the model's, a name is unknown, or the film would be too long.

    Examples
    --------
    >>> import varint as vi
    >>> import varint.multibody as mb
    >>> world = mb.Model()
    >>> rod = world.body(1.0, com=(0, 0, -0.5), inertia=0.1, name="rod")
    >>> hinge = world.revolute(world, rod, axis=(0, 1, 0), name="hinge")
    >>> tip = world.marker(rod, at=(0, 0, -1), name="tip")
    >>> motion = vi.simulate(world.system(), q0=[1.0], v0=[0.0], h=0.02, steps=5)
    >>> film = mb.animate(world, motion, traces=["tip"])
    """
    require_trajectory(motion)
    times = frame_times(motion, speed, film_interval(path, fps))
    bodies, axes, ways, size = _scene(model, motion, times, frames, traces)
    return body_film(bodies, axes, ways, times, arm=ARM * size, fps=fps, path=path)


def page(
    model: Model,
    motion: Trajectory,
    path: Any,
    *,
    speed: float = 1.0,
    fps: float = 25.0,
    frames: Sequence[str] = (),
    traces: Sequence[str] = (),
    title: str = "",
) -> None:
    """One HTML file that plays a machine's motion, to be turned and zoomed; it needs no network.

    Parameters
    ----------
    model, motion, speed, fps, frames, traces
        As in `animate`.
    path : path
        The file, ``.html``; it holds the library plotly (``varint-mechanics[view]``) itself.
    title : str, optional

    Raises
    ------
    InputError
        If plotly is not installed, the name does not end in .html, or as in `animate`.
    """
    require_trajectory(motion)
    times = frame_times(motion, speed, 1 / fps if fps > 0 else 0.04)
    bodies, axes, ways, size = _scene(model, motion, times, frames, traces)
    write_body_page(bodies, axes, ways, times, arm=ARM * size, fps=fps, path=path, title=title)


def skeleton(model: Model, traces: Sequence[str] = ()) -> Sketch:
    """Origins of bodies and markers, joined along the tree, as a `Sketch`.

    It is what `Trajectory.animate` draws: lighter than `animate`, without shapes.

    Parameters
    ----------
    model : Model
    traces : sequence of str, optional
        Bodies and markers whose path is drawn.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> world = mb.Model()
    >>> rod = world.body(1.0, com=(0, 0, -0.5), inertia=0.1, name="rod")
    >>> hinge = world.revolute(world, rod, axis=(0, 1, 0), name="hinge")
    >>> tip = world.marker(rod, at=(0, 0, -1), name="tip")
    >>> mb.skeleton(world, traces=["tip"])
    Sketch(world, rod, tip; 2 rods, 3 dimensions)
    """
    points = {WORLD: ca.SX.zeros(3)}
    points |= {name: model.frame(name).position for name in (*model.bodies, *model.markers)}
    rods = [(joint.parent, joint.child) for joint in model.joints.values()]
    rods += [(anchor.body, name) for name, anchor in model.markers.items()]
    return Sketch(points, rods=rods, traces=traces, marks=list(traces))


Scene = tuple[
    list[MovingBody], dict[str, tuple[np.ndarray, np.ndarray]], dict[str, np.ndarray], float
]


def _scene(
    model: Model,
    motion: Trajectory,
    times: np.ndarray,
    frames: Sequence[str],
    traces: Sequence[str],
) -> Scene:
    """Bodies, frames and traces at these times, and half the size of the whole."""
    if tuple(motion.system.names) != tuple(model.system().names):
        raise InputError(
            f"the motion has the coordinates {list(motion.system.names)}, the model "
            f"{list(model.system().names)}; give the motion of model.system()"
        )
    moving = motion.at(times)
    names = list(model.bodies)
    spots = _places(model, moving, [*names, *frames, *traces])
    bodies = []
    for name in [WORLD, *names]:
        shapes = model.bodies[name].visuals if name in model.bodies else ()
        for shape in shapes:
            if shape.mesh is None or can_read(shape.mesh):
                bodies.append(_moving_shape(name, shape, *spots[name]))
    drawn = {body.name for body in bodies}
    reach = max(np.ptp(np.vstack([x for x, _ in spots.values()]), axis=0).max(), SMALLEST)
    bodies += [
        MovingBody(name, rods, GREY, *spots[name])
        for name in names
        if name not in drawn and (rods := _rods(model, name, STICK * reach)) is not None
    ]
    if not bodies:
        raise InputError("the model has nothing to draw: no shapes, and no joints apart")
    _, half = extent([box_corners(body) for body in bodies])
    axes = {name: spots[name] for name in frames}
    return bodies, axes, {name: spots[name][0] for name in traces}, half


def _places(
    model: Model, motion: Trajectory, names: Sequence[str]
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Positions (F, 3) and rotations (F, 3, 3) of bodies and markers."""
    unique = list(dict.fromkeys(names))
    found = [model.frame(name) for name in unique]
    value = motion.value(ca.horzcat(*(ca.horzcat(x.position, x.rotation) for x in found)))
    parts = {
        name: (value[:, :, 4 * k], value[:, :, 4 * k + 1 : 4 * k + 4])
        for k, name in enumerate(unique)
    }
    still = np.zeros((len(motion), 3)), np.tile(np.eye(3), (len(motion), 1, 1))
    return parts | {WORLD: still}


def _rods(model: Model, name: str, radius: float) -> Surface | None:
    """Rods in a body's frame from its joint to the next ones, its markers and centre of mass."""
    joints, here = model.joints.values(), np.zeros(3)
    for joint in joints:
        if joint.child == name:
            here = _numbers(joint.child_placement.position)
    ends = [_numbers(joint.placement.position) for joint in joints if joint.parent == name]
    ends += [_numbers(x.placement.position) for x in model.markers.values() if x.body == name]
    ends.append(_numbers(model.bodies[name].com))
    parts = [rod for end in ends if (rod := _rod(here, end, radius)) is not None]
    if not parts:
        return None
    first = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Surface(
        np.vstack([part.vertices for part in parts]),
        np.vstack([part.faces + k for part, k in zip(parts, first, strict=True)]),
    )


def _rod(start: np.ndarray, end: np.ndarray, radius: float) -> Surface | None:
    along = end - start
    length = float(np.linalg.norm(along))
    if length < radius:
        return None
    rod = primitive("cylinder", (radius, length / 2))
    turn = frame_along(along / length)
    return Surface(rod.vertices @ turn.T + (start + end) / 2, rod.faces)


def _numbers(x: Any) -> np.ndarray:
    """A place whose numbers are parameters is drawn at the origin."""
    return np.zeros(3) if isinstance(x, ca.SX) else np.asarray(x, float)


def _moving_shape(
    name: str, shape: Shape, positions: np.ndarray, rotations: np.ndarray
) -> MovingBody:
    """A shape's surface in the frame of its body."""
    own = shape_surface(shape)
    place = shape.placement
    placed = Surface(own.vertices @ place.rotation.T + place.position, own.faces)
    return MovingBody(name, placed, shape.colour, positions, rotations)


def shape_surface(shape: Shape) -> Surface:
    """Triangles of a shape in its own frame; a mesh that cannot be read is an empty surface."""
    if shape.kind != "mesh" or shape.mesh is None:
        return primitive(shape.kind, shape.size)
    found = surface(shape.mesh, f"the mesh {shape.mesh.path.name}")
    if len(found.faces) > MOST_FACES:
        found = found.convex_hull
    return Surface(np.asarray(found.vertices, float), np.asarray(found.faces))
