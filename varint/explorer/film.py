"""A motion as the arrays that a page shows, frame by frame: places, energy, momenta."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from varint.drawing.animation import extent, frame_times, places
from varint.drawing.sketch import Sketch
from varint.explorer.scene import Scene
from varint.results.trajectory import Trajectory

SECONDS = 0.04  # between frames on the screen
SHORTEST, LONGEST = 2.0, 30.0  # seconds that a film may last before its speed is changed, to 10 s
CURVE = 1500  # points of a curve over time
# from where a scene in space is seen, as matplotlib does: 30 degrees above, 60 to the right
ELEVATION, AZIMUTH = np.deg2rad(30), np.deg2rad(-60)


@dataclass(frozen=True, eq=False)
class Film:
    """Frames of a motion.

    Attributes
    ----------
    t : ndarray (frames,)
        Times of the frames.
    speed : float
        Time of the motion in a second on the screen.
    places : dict of str to ndarray (frames, 2)
        Of every point of the sketch, as it is seen.
    middle, half : ndarray (2,), float
        Of the picture.
    curve_t : ndarray (points,)
        Times of the curves.
    energy, momenta : ndarray (points,), (points, n)
        E − E(0), and p.
    at_frames : ndarray (frames, 1 + n)
        Energy and momenta at the frames.
    """

    t: np.ndarray
    speed: float
    places: dict[str, np.ndarray]
    middle: np.ndarray
    half: float
    curve_t: np.ndarray
    energy: np.ndarray
    momenta: np.ndarray
    at_frames: np.ndarray


def film_of(scene: Scene, motion: Trajectory) -> Film:
    """The frames of a motion of the scene."""
    lasts = abs(motion.duration)
    speed = 1.0 if SHORTEST <= lasts <= LONGEST else lasts / 10
    times = frame_times(motion, speed, SECONDS)
    frames = motion.at(times)
    shown = _seen(scene.sketch, frames) if scene.sketch else {}
    middle, half = extent(list(shown.values())) if shown else (np.zeros(2), 1.0)
    nodes = motion[np.unique(np.linspace(0, len(motion) - 1, min(len(motion), CURVE)).astype(int))]
    energy = nodes.energy
    return Film(
        t=times,
        speed=speed,
        places=shown,
        middle=middle,
        half=half,
        curve_t=nodes.t,
        energy=energy - energy[0],
        momenta=nodes.p,
        at_frames=np.column_stack([frames.energy, frames.p]),
    )


def _seen(sketch: Sketch, frames: Trajectory) -> dict[str, np.ndarray]:
    """Places in the plane of the screen; those in space as they are seen from afar."""
    found = places(frames, sketch)
    if sketch.dimensions == 2:
        return found
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    towards = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH)]) * np.cos(ELEVATION)
    up = np.cross([*towards, np.sin(ELEVATION)], right)
    return {name: where @ np.column_stack([right, up]) for name, where in found.items()}
