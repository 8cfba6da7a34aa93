"""Animations of trajectories: points, rods and traces, at a speed true to time."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from varint.drawing.sketch import Sketch, cartesian
from varint.drawing.style import COLOURS, handed_over
from varint.errors import InputError, parsed_or_refused
from varint.numerics.progress import progress_bar
from varint.scene.inputs import number

if TYPE_CHECKING:
    from matplotlib.animation import AbstractMovieWriter, FuncAnimation

    from varint.results.trajectory import Trajectory

MOST_FRAMES = 20_000
# points of each trace, at least and at most: enough for any screen
SMOOTH, TRACE_POINTS = (
    500,
    2000,
)
MARGIN = 0.05  # of the picture's size
GIF_TICK = 0.01  # s; GIF files count in hundredths
SIZE, DPI = (5.6, 5.0), 100


def trajectory_animation(
    motion: Trajectory,
    path: Any = None,
    *,
    sketch: Sketch | None = None,
    speed: float = 1.0,
    fps: float = 25.0,
    trace: float | None = None,
) -> FuncAnimation:
    """Animation of a trajectory; see `Trajectory.animate`."""
    import matplotlib.pyplot as plt

    target = film_target(path)
    writer, seconds = film_writer(target, fps)
    times = frame_times(motion, speed, seconds)
    if not isinstance(sketch, Sketch | None):
        raise InputError(f"sketch must be a varint.Sketch, got {sketch!r}")
    _check_trace(trace)
    sketch = sketch or cartesian(motion.system.names, motion.system.q)
    if sketch is None:
        raise InputError(
            f"the coordinates {list(motion.system.names)} do not say where anything is; give "
            "sketch=varint.Sketch("
            '{"bob": ca.vertcat(x, y)}, rods=…, traces=…)'
        )
    # dense output between nodes, then one more round over the finer times that traces are drawn
    # with
    frames = places(motion.at(times), sketch)
    past = np.linspace(
        motion.t[0], motion.t[-1], min(max(len(times), len(motion), SMOOTH), TRACE_POINTS)
    )
    trail = places(motion.at(past), sketch) if sketch.traces else {}
    fig = plt.figure(figsize=SIZE, dpi=DPI, layout="constrained")
    axes = fig.add_subplot(projection="3d") if sketch.dimensions == 3 else fig.add_subplot()
    framed(axes, [*frames.values(), *trail.values()])
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(sketch.marks)}
    empty: list[list[float]] = [[]] * sketch.dimensions
    trails = {
        name: axes.plot(*empty, lw=1, alpha=0.6, color=colours.get(name, COLOURS[0]))[0]
        for name in sketch.traces
    }
    rods = [axes.plot(*empty, lw=2, color="0.25", solid_capstyle="round")[0] for _ in sketch.rods]
    dots = {name: axes.plot(*empty, "o", ms=7, color=colours[name])[0] for name in sketch.marks}
    clock = axes.set_title("t = 0", y=1.0)
    fig.draw_without_rendering()
    fig.set_layout_engine("none")  # laid out once, not for every frame

    decimals = max(0, 1 + int(np.floor(-np.log10(speed * seconds))))  # enough to tell frames apart

    def draw(frame: int) -> list:
        now = times[frame]
        for name, line in trails.items():
            age = (now - past) * np.sign(motion.h)
            keep = (age >= 0) & (age <= (np.inf if trace is None else trace))
            _move(line, np.vstack([trail[name][keep], frames[name][frame]]))
        for (a, b), line in zip(sketch.rods, rods, strict=True):
            _move(line, np.vstack([frames[a][frame], frames[b][frame]]))
        for name, line in dots.items():
            _move(line, frames[name][frame][None])
        clock.set_text(f"t = {now:.{decimals}f}")
        return [*trails.values(), *rods, *dots.values(), clock]

    moving = [*trails.values(), *rods, *dots.values(), clock]
    return film_of(fig, draw, moving, len(times), seconds, target, writer)


def film_of(
    fig: Any,
    draw: Callable[[int], list],
    moving: list,
    count: int,
    seconds: float,
    target: Path | None,
    writer: AbstractMovieWriter | None,
) -> FuncAnimation:
    """The film of a figure in which `draw` moves the artists `moving`, written where a file is
    asked for.
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation

    film = FuncAnimation(fig, draw, frames=count, interval=1000 * seconds, repeat=True)
    film._draw_was_started = True  # type: ignore[attr-defined]  # shown or saved later by whoever asked: no warning if it is neither
    film._repr_html_ = lambda: _shown(  # type: ignore[method-assign]
        _pictures(fig, draw, moving, count), seconds, count, target
    )
    if target is not None:
        with progress_bar(count, "frames", None) as move:
            if writer is None:
                _write_gif(target, _pictures(fig, draw, moving, count), seconds, move)
            else:
                _freeze(fig, moving)
                with writer.saving(fig, target, DPI):
                    for frame in range(count):
                        draw(frame)
                        writer.grab_frame()
                        move(1, lambda: str(target.name))
        plt.close(fig)
    handed_over(fig)
    return film


def _pictures(fig: Any, draw: Callable[[int], list], moving: list, count: int) -> Iterator[Any]:
    """The last frame, which has every colour, then all frames in turn: what moves, drawn upon the
    picture of what does not.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    if not hasattr(fig.canvas, "copy_from_bbox"):  # pyplot took it away when the figure was closed
        FigureCanvasAgg(fig)
    still = _still(fig, moving)
    for frame in (count - 1, *range(count)):
        draw(frame)
        fig.canvas.restore_region(still)
        for artist in moving:
            artist.axes.draw_artist(artist)
        yield Image.fromarray(np.asarray(fig.canvas.buffer_rgba())).convert("RGB")


def _shown(pictures: Iterator[Any], seconds: float, count: int, target: Path | None) -> str:
    """What a notebook shows of a film: it plays inside, as the GIF that was written or would be."""
    if target is not None and target.suffix.lower() == ".gif" and target.exists():
        data = target.read_bytes()
    else:
        played = io.BytesIO()
        with progress_bar(count, "frames", None) as move:
            _write_gif(played, pictures, max(seconds, 2 * GIF_TICK), move)
        data = played.getvalue()
    encoded = b64encode(data).decode()
    return f'<img alt="Film of the motion." src="data:image/gif;base64,{encoded}">'


def _write_gif(target: Any, pictures: Iterator[Any], seconds: float, move: Callable) -> None:
    """A GIF, as a file or in memory, of all pictures but the first, in the 256 colours of the
    first.
    """
    colours = next(pictures).quantize()

    def frames() -> Iterator[Any]:
        for picture in pictures:
            move(1, lambda: str(getattr(target, "name", "")))
            yield picture.quantize(palette=colours, dither=0)

    each = frames()
    milliseconds = round(1000 * seconds)
    settings = dict(save_all=True, append_images=each, duration=milliseconds, loop=0)
    next(each).save(target, format="GIF", **settings)


def _still(fig: Any, moving: list) -> Any:
    """The picture of all that does not move, as the canvas keeps it."""
    for artist in moving:
        artist.set_visible(False)
    fig.canvas.draw()
    still = fig.canvas.copy_from_bbox(fig.bbox)
    for artist in moving:
        artist.set_visible(True)
    return still


def _freeze(fig: Any, moving: list) -> None:
    """Replace all that does not move by its picture: drawing axes and grid anew takes most of a
    frame's time.
    """
    _still(fig, moving)
    still = np.asarray(fig.canvas.buffer_rgba()).copy()
    for axes in fig.axes:
        axes.set_axis_off()
        axes.patch.set_visible(False)
    fig.figimage(still, zorder=-1)


def frame_times(motion: Trajectory, speed: float, seconds: float) -> np.ndarray:
    """Times of the frames, `seconds` apart on the screen, from the first node to the last."""
    if not number("speed", speed) > 0:
        raise InputError(
            f"speed is the time of the motion per second of film, a positive number; got {speed!r}"
        )
    count = int(np.floor(abs(motion.duration) / (speed * seconds) * (1 + 1e-12))) + 1
    if count > MOST_FRAMES:
        raise InputError(
            f"{count} frames are too many (limit {MOST_FRAMES}); raise speed= or animate a slice"
        )
    return motion.t[0] + np.sign(motion.duration or 1.0) * speed * seconds * np.arange(count)


def places(motion: Trajectory, sketch: Sketch) -> dict[str, np.ndarray]:
    """Positions of every point at every node, (N + 1, 2 or 3)."""
    return {name: motion.value(where) for name, where in sketch.points.items()}


def film_interval(path: Any, fps: float) -> float:
    """Seconds between the pictures of a film, which its kind of file keeps."""
    return film_writer(film_target(path), fps)[1]


def film_target(path: Any) -> Path | None:
    """Where a film is to be written; None where it is only shown."""
    if path is None:
        return None
    target = parsed_or_refused(
        lambda: Path(path), lambda: f"path must be the name of a file, got {path!r}"
    )
    if not target.parent.is_dir():
        raise InputError(
            f"cannot write {target}: there is no folder {target.parent}; make it before"
        )
    return target


def _check_trace(trace: Any) -> None:
    """Refuse what is no length of traces in time; infinity is all of the past."""
    endless = trace is None or (isinstance(trace, float) and trace == np.inf)
    if not endless and not number("trace", trace) >= 0:
        raise InputError(f"trace is a length in time, not negative, got {trace!r}")


def film_writer(path: Path | None, fps: float) -> tuple[AbstractMovieWriter | None, float]:
    """Writer for the file's kind, none for GIF files, and the time between frames that it keeps."""
    from matplotlib import animation

    if not number("fps", fps) > 0:
        raise InputError(f"fps must be a positive number, got {fps!r}")
    if path is None:
        return None, 1 / fps
    kind = path.suffix.lower()
    rate: Any = fps  # annotated as int, but any number does
    if kind == ".gif":
        ticks = max(round(1 / (fps * GIF_TICK)), 2)  # viewers slow down what is shorter
        return None, ticks * GIF_TICK
    if kind == ".html":
        return animation.HTMLWriter(fps=rate, embed_frames=True), 1 / fps
    if kind == ".mp4":
        if not animation.FFMpegWriter.isAvailable():
            raise InputError(
                "mp4 needs the program ffmpeg, which is not installed; write a .gif or .html "
                "instead"
            )
        return animation.FFMpegWriter(fps=rate, extra_args=["-pix_fmt", "yuv420p"]), 1 / fps
    raise InputError(f"{path} is no film: give a name that ends in .gif, .mp4 or .html")


def extent(found: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Middle and half of the side of the square or cube that holds all these places."""
    every = np.vstack(found)
    low, high = every.min(axis=0), every.max(axis=0)
    return (low + high) / 2, max((high - low).max() / 2, 1e-12) * (1 + 2 * MARGIN)


def framed(axes: Any, found: list[np.ndarray]) -> None:
    """Limits that hold the whole motion, equal scales, and names of the axes."""
    middle, half = extent(found)
    for name, centre in zip("xyz", middle, strict=False):
        axes.set(**{f"{name}lim": (centre - half, centre + half), f"{name}label": f"${name}$"})
    axes.set_aspect("equal")
    if len(middle) == 2:
        axes.grid(alpha=0.3)
    else:
        axes.locator_params(nbins=4)  # labels in perspective stand close


def _move(line: Any, points: np.ndarray) -> None:
    if points.shape[1] == 3:
        line.set_data_3d(*points.T)
    else:
        line.set_data(*points.T)
