"""Surfaces from files by trimesh: for drawings, and for the inertia of what they enclose."""

from __future__ import annotations

import importlib.util
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.multibody.data import Placement
from varint.multibody.elements import contents
from varint.multibody.solids import MassProperties

KINDS = ("stl", "obj", "ply", "off")  # surfaces in one file that refers to no other
HERE = Placement(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A file with a surface, how it is stretched, and the frame that its points are seen from."""

    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    base: Placement = HERE


def can_read(mesh: Mesh) -> bool:
    """Whether the surface can be read here: a kind of file that is known, and trimesh there."""
    known = mesh.path.suffix.lower().lstrip(".") in KINDS
    return known and importlib.util.find_spec("trimesh") is not None


def surface(mesh: Mesh, asked_by: str) -> Any:
    """The surface as trimesh has it, stretched and seen from its base.

    Raises
    ------
    InputError
        If trimesh is not installed, or the file holds no surface of a known kind.
    """
    kind = mesh.path.suffix.lower().lstrip(".")
    if kind not in KINDS:
        raise InputError(f"{asked_by}: {mesh.path.name} is none of the files {KINDS}")
    if importlib.util.find_spec("trimesh") is None:
        raise InputError(
            f"{asked_by}: reading {mesh.path.name} needs trimesh; pip install "
            "'varint-mechanics[view]', or give the mass and inertia themselves"
        )
    import trimesh

    data = contents(mesh.path)  # as bytes: what it refers to is not looked for
    found = parsed_or_refused(
        lambda: trimesh.load_mesh(io.BytesIO(data), file_type=kind),
        lambda: f"{asked_by}: {mesh.path.name} cannot be read as {kind.upper()}",
    )
    vertices = np.asarray(getattr(found, "vertices", ()), dtype=float)
    if not len(vertices) or not len(found.faces) or not np.isfinite(vertices).all():
        raise InputError(f"{asked_by}: {mesh.path.name} holds no surface")
    seen = (vertices - mesh.base.position) @ mesh.base.rotation
    found.vertices = seen * np.array(mesh.scale)
    if np.prod(mesh.scale) < 0:
        found.invert()
    return found


def read_mesh(mesh: Mesh, asked_by: str) -> MassProperties:
    """Mass properties at density one of what a closed surface encloses.

    Raises
    ------
    InputError
        If the surface has holes.
    """
    found = surface(mesh, asked_by)
    if not found.is_watertight or not found.is_winding_consistent or abs(found.volume) == 0:
        raise InputError(
            f"{asked_by}: {mesh.path.name} is no closed surface, so it encloses no mass; give the "
            "mass and inertia themselves (<inertial>)"
        )
    sign = np.sign(found.volume)
    inertia = sign * np.asarray(found.moment_inertia)
    return MassProperties(abs(float(found.volume)), np.asarray(found.center_mass), inertia)
