"""Films of rigid bodies in space: shaded surfaces, axes of frames, traces of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.animation import DPI, film_of, film_target, film_writer, framed
from varint.drawing.style import COLOURS
from varint.drawing.surfaces import MovingBody, box_corners, outward_normals

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

SIZE = (6.4, 6.0)
LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
DIM = 0.45  # brightness of what the light does not reach
AXES = ("#D55E00", "#009E73", "#0072B2")  # of a frame: x, y, z


def body_film(
    bodies: Sequence[MovingBody],
    frames: Mapping[str, tuple[np.ndarray, np.ndarray]],
    traces: Mapping[str, np.ndarray],
    times: np.ndarray,
    *,
    arm: float,
    fps: float,
    path: Any,
) -> FuncAnimation:
    """A film of moving bodies.

    Parameters
    ----------
    bodies : sequence of MovingBody
    frames : mapping of str to ((F, 3), (F, 3, 3))
        Frames whose axes are drawn, of length `arm`.
    traces : mapping of str to (F, 3)
        Points whose way so far is drawn.
    times : array (F,)
    arm, fps : float
    path : path or None
        Where to write it: .gif, .html or .mp4.
    """
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    target = film_target(path)
    writer, seconds = film_writer(target, fps)
    fig = plt.figure(figsize=SIZE, dpi=DPI, layout="constrained")
    axes: Any = fig.add_subplot(projection="3d")
    held = [box_corners(body) for body in bodies] + list(traces.values())
    framed(axes, held + [positions for positions, _ in frames.values()])
    skin = Poly3DCollection(_corners(bodies, 0), zsort="average")
    axes.add_collection3d(skin)
    paints = np.concatenate([np.tile(b.colour, (len(b.surface.faces), 1)) for b in bodies])
    empty: list[list[float]] = [[]] * 3
    trails = {
        name: axes.plot(*empty, lw=1.2, color=COLOURS[i % len(COLOURS)])[0]
        for i, name in enumerate(traces)
    }
    arms = {
        name: [axes.plot(*empty, lw=1.5, color=colour)[0] for colour in AXES] for name in frames
    }
    clock = axes.set_title("t = 0", y=1.0)
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    gap = abs(times[1] - times[0]) if len(times) > 1 else 1.0
    decimals = max(0, 1 + int(np.floor(-np.log10(gap))))
    moving = [skin, *trails.values(), *(line for lines in arms.values() for line in lines), clock]

    def draw(frame: int) -> list:
        triangles = _corners(bodies, frame)
        skin.set_verts(triangles)
        # both sides are lit: surfaces from files are not always turned outwards
        bright = DIM + (1 - DIM) * abs(outward_normals(triangles) @ LIGHT)
        shaded = paints.copy()
        shaded[:, :3] *= bright[:, None]
        skin.set_facecolor(shaded)
        axes.M = axes.get_proj()
        skin.do_3d_projection()  # else only a redraw of all would do it
        for name, line in trails.items():
            line.set_data_3d(*traces[name][: frame + 1].T)
        for name, lines in arms.items():
            position, rotation = (part[frame] for part in frames[name])
            for k, line in enumerate(lines):
                line.set_data_3d(*np.array([position, position + arm * rotation[:, k]]).T)
        clock.set_text(f"t = {times[frame]:.{decimals}f}")
        return moving

    draw(0)
    return film_of(fig, draw, moving, len(times), seconds, target, writer)


def _corners(bodies: Sequence[MovingBody], frame: int) -> np.ndarray:
    """The corners in space of all triangles, (m, 3, 3)."""
    return np.concatenate([body.at(frame)[body.surface.faces] for body in bodies])
