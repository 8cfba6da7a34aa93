"""What is drawn of a body: primitives and surfaces from files, each in the body's frame."""

from __future__ import annotations

from dataclasses import dataclass

from varint.multibody.data import Placement
from varint.multibody.mesh import Mesh

GREY = (0.7, 0.7, 0.7, 1.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """A primitive or a mesh in the frame of its body, its axis along z.

    Attributes
    ----------
    kind : str
        "sphere" (radius), "cylinder" or "capsule" (radius, half-length), "box" or "ellipsoid"
        (half-axes), "mesh".
    size : tuple of float
    placement : Placement
    colour : tuple of four floats
        Red, green, blue, opacity.
    mesh : Mesh or None
    """

    kind: str
    size: tuple[float, ...]
    placement: Placement
    colour: tuple[float, ...] = GREY
    mesh: Mesh | None = None
