"""Triangles of primitive bodies, and bodies that move as wholes, as data for films and pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# corners around an axis and from pole to pole: round enough for a film, few enough to turn
AROUND, ALONG = 20, 13
# corners of a box by the bits of x, y, z; its sides run around outwards
BOX_SIDES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles: corners (n, 3) and, for each triangle, the numbers of its corners (m, 3)."""

    vertices: np.ndarray
    faces: np.ndarray


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A rigid surface and where it is in each frame of a film.

    Attributes
    ----------
    name : str
    surface : Surface
        In the body's own frame.
    colour : tuple of four floats
        Red, green, blue, opacity.
    positions : array (frames, 3)
    rotations : array (frames, 3, 3)
        Body to space.
    """

    name: str
    surface: Surface
    colour: tuple[float, ...]
    positions: np.ndarray
    rotations: np.ndarray

    def at(self, frame: int) -> np.ndarray:
        """The corners in space, (n, 3)."""
        return self.positions[frame] + self.surface.vertices @ self.rotations[frame].T


def primitive(kind: str, size: Sequence[float]) -> Surface:
    """A sphere (radius), ellipsoid or box (half-axes), cylinder or capsule (radius, half-length)
    about its centre, its axis along z.
    """
    if kind == "box":
        corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
        halves = [half for a, b, c, d in BOX_SIDES for half in ((a, b, c), (a, c, d))]
        return Surface(corners * np.array(size), np.array(halves))
    if kind == "cylinder":
        radius, half = size
        return _lathe(np.array([0, radius, radius, 0]), np.array([-half, -half, half, half]))
    angle = np.linspace(-np.pi / 2, np.pi / 2, ALONG)
    radii, heights = np.cos(angle), np.sin(angle)
    radii[[0, -1]] = 0.0  # not cos of what is written as π/2
    if kind == "capsule":
        radius, half = size
        middle = len(angle) // 2 + 1
        low, high = slice(0, middle), slice(middle - 1, None)
        return _lathe(
            radius * np.concatenate([radii[low], radii[high]]),
            np.concatenate([radius * heights[low] - half, radius * heights[high] + half]),
        )
    ball = _lathe(radii, heights)
    return Surface(ball.vertices * (np.array(size) if kind == "ellipsoid" else size[0]), ball.faces)


def _lathe(radii: np.ndarray, heights: np.ndarray) -> Surface:
    """The surface that a line (radius, height) sweeps about the z-axis."""
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    rings = np.stack(
        [
            radii[:, None] * np.cos(turn),
            radii[:, None] * np.sin(turn),
            heights[:, None] + 0 * turn,
        ],
        axis=-1,
    )
    ring, step = np.meshgrid(np.arange(len(radii) - 1), np.arange(AROUND), indexing="ij")
    a, b = ring * AROUND + step, ring * AROUND + (step + 1) % AROUND
    c, d = a + AROUND, b + AROUND
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    vertices = rings.reshape(-1, 3)
    sides = vertices[faces]
    flat = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    return Surface(vertices, faces[flat > 0])  # none at the poles, where corners coincide


def box_corners(body: MovingBody) -> np.ndarray:
    """The corners in space, in every frame, of the box around a body, (8 F, 3)."""
    ends = np.array([body.surface.vertices.min(axis=0), body.surface.vertices.max(axis=0)])
    box = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
    turned = np.einsum("fij,nj->fni", body.rotations, box) + body.positions[:, None]
    return turned.reshape(-1, 3)


def outward_normals(corners: np.ndarray) -> np.ndarray:
    """Unit normals (m, 3) of triangles (m, 3, 3), zero for those without an area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
