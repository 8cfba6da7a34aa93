"""Frames and geoms of MJCF: where they stand, and the mass that they have."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.multibody.data import Placement
from varint.multibody.elements import Element, file_within, words
from varint.multibody.mesh import Mesh, read_mesh
from varint.multibody.mjcf_settings import ORIENTATIONS, Reading, Settings, boolean, chosen
from varint.multibody.quantities import compose
from varint.multibody.rotations import axis_rotation, quaternion_matrix, tidied
from varint.multibody.solids import NOTHING, MassProperties, area, shell, solid, volume

WATER = 1000.0  # kg/m³, the density of geoms that give none
LARGEST = 1e50  # m; the fifth power of a size is still a number
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
HARMLESS = words(
    "name class contype conaffinity condim group priority friction solmix solref solimp margin gap "
    "surfacevel adhesion material rgba user fluidshape fluidcoef fitscale hfield castshadow info"
)
READ = words("type pos size mass density shellinertia fromto mesh")


@dataclass(frozen=True, eq=False)
class Geom:
    """A geom in its body's frame: what is drawn, and its mass."""

    kind: str
    size: tuple[float, ...]
    placement: Placement
    mass: MassProperties  # in the body's frame
    group: int
    colour: tuple[float, ...] | None
    mesh: Mesh | None = None
    masks: tuple[int, int] = (1, 1)  # what it touches, and what touches it


def placement_of(element: Element, settings: Settings) -> Placement:
    """Position and orientation of an element in the frame that it stands in."""
    position = element.numbers("pos", 3, np.zeros(3))
    return Placement(position, orientation_of(element, settings))


def orientation_of(element: Element, settings: Settings) -> np.ndarray:
    """R of the one orientation that an element gives."""
    ways = [name for name in ORIENTATIONS if name in element.attributes]
    if not ways:
        return np.eye(3)
    if len(ways) > 1:
        raise InputError(f"{element.where} gives its orientation {len(ways)} times: {ways}")
    way, unit = ways[0], settings.angle
    if way == "quat":
        w = element.numbers(way, 4)
        return quaternion_matrix(w / nonzero(element, way, w))
    if way == "axisangle":
        *axis, angle = element.numbers(way, 4)
        nonzero(element, way, axis)
        return axis_rotation(axis, angle * unit)
    if way == "zaxis":
        z = element.numbers(way, 3)
        nonzero(element, way, z)
        return z_to(z)
    if way == "xyaxes":
        x, y = element.numbers(way, 6).reshape(2, 3)
        nonzero(element, way, np.cross(x, y))
        return two_axes(x, y)
    return euler_rotation(element.numbers(way, 3) * unit, settings.sequence)


def nonzero(element: Element, name: str, vector: Any) -> float:
    """The length of a vector that must not vanish."""
    length = float(np.linalg.norm(vector))
    if length < 1e-12:
        raise InputError(f"{element.where}: {name}={element.attributes[name]!r} gives no direction")
    return length


def euler_rotation(angles: Any, sequence: str) -> np.ndarray:
    """R of three turns; lower-case axes turn with the body, upper-case ones stay."""
    rotation = np.eye(3)
    for angle, name in zip(angles, sequence, strict=True):
        turn = axis_rotation(np.eye(3)["xyz".index(name.lower())], angle)
        rotation = rotation @ turn if name.islower() else turn @ rotation
    return tidied(rotation)


def z_to(direction: np.ndarray) -> np.ndarray:
    """The smallest turn that brings the z-axis to a direction (about x to the opposite one)."""
    z = direction / np.linalg.norm(direction)
    sine = np.hypot(z[0], z[1])
    return axis_rotation([-z[1], z[0], 0] if sine > 0 else [1, 0, 0], np.arctan2(sine, z[2]))


def two_axes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """R of a frame's x-axis and another direction in its x-y-plane."""
    x = x / np.linalg.norm(x)
    y = y - x * (x @ y)
    y = y / np.linalg.norm(y)
    return tidied(np.column_stack([x, y, np.cross(x, y)]))


def geom_of(element: Element, outer: Placement, reading: Reading) -> Geom:
    """A geom, with the defaults of its class already in it, that stands in the frame `outer`."""
    geom = _geom(element, reading)
    return replace(
        geom,
        placement=compose(outer, geom.placement),
        mass=geom.mass.seen_from(*outer),
        masks=(int(element.number("contype", 1.0)), int(element.number("conaffinity", 1.0))),
    )


def _geom(element: Element, reading: Reading) -> Geom:
    settings = reading.settings
    reading.unread.only(element, (), [*READ, *HARMLESS, *ORIENTATIONS])
    fluid = settings.density > 0 or settings.viscosity > 0
    if fluid and element.attributes.get("fluidshape", "none") != "none":
        raise InputError(f"{element.where}: the fluid forces of single geoms are not read")
    kinds = {name: name for name in (*SIZES, "plane", "hfield", "mesh", "sdf")}
    kind = chosen(element, "type", kinds) if "type" in element.attributes else "sphere"
    group = int(element.number("group", 0.0))
    rgba = element.optional("rgba", 4)
    colour = None if rgba is None else tuple(map(float, rgba))
    placement = placement_of(element, settings)
    if kind in ("plane", "hfield"):
        plate = element.numbers("size", None, (1, 1, 1), most=4)
        return Geom(kind, tuple(plate), placement, NOTHING, group, colour)
    if kind == "sdf":
        raise InputError(f"{element.where}: signed distance fields are not read")
    if kind == "mesh" or "mesh" in element.attributes:
        return _mesh_geom(element, reading, placement, group, colour)
    size, placement = _size(element, kind, placement)
    is_shell = boolean(element, "shellinertia")
    if is_shell and kind == "ellipsoid":
        raise InputError(f"{element.where}: the inertia of an ellipsoidal shell has no closed form")
    content = area(kind, size) if is_shell else volume(kind, size)
    mass = _mass(element, content)
    own = (shell if is_shell else solid)(kind, size, mass)
    return Geom(kind, size, placement, own.seen_from(*placement), group, colour)


def _mass(element: Element, content: float) -> float:
    """What a geom weighs: its own mass, else density times volume (or surface of a shell)."""
    if "mass" in element.attributes:
        mass = element.number("mass")
    else:
        mass = element.number("density", WATER) * content
    if mass < 0:
        raise InputError(f"{element.where} has a negative mass, {mass:g}")
    return mass


def _size(element: Element, kind: str, placement: Placement) -> tuple[tuple[float, ...], Placement]:
    """The sizes of a primitive, and where it stands where its two ends say so."""
    count = SIZES[kind]
    ends = element.optional("fromto", 6)
    given = element.numbers("size", None, (), most=3)
    needed = 1 if ends is not None else count
    if ends is not None and kind == "sphere":
        raise InputError(f"{element.where}: a sphere has no fromto")
    used = given[:needed]
    if len(used) < needed or (used <= 0).any() or (used > LARGEST).any():
        raise InputError(
            f"{element.where}: a {kind} needs {needed} positive sizes below {LARGEST:g}, got "
            f"{given.tolist()}"
        )
    if ends is None:
        return tuple(map(float, given[:count])), placement
    along = ends[:3] - ends[3:]  # MuJoCo's z-axis runs from the second end to the first
    half = nonzero(element, "fromto", along) / 2
    size = (given[0], half) if count == 2 else (given[0], given[0], half)
    return tuple(map(float, size)), Placement((ends[:3] + ends[3:]) / 2, z_to(along))


def _mesh_geom(
    element: Element,
    reading: Reading,
    placement: Placement,
    group: int,
    colour: tuple[float, ...] | None,
) -> Geom:
    """A geom whose shape is a file: its inertia is that of the volume within the surface."""
    if element.attributes.get("type", "mesh") != "mesh":
        raise InputError(
            f"{element.where}: fitting a primitive to a mesh is not read; give the primitive's size"
        )
    name = element.text("mesh")
    if name not in reading.meshes:
        raise InputError(f"{element.where}: unknown mesh {name!r}; known: {sorted(reading.meshes)}")
    mesh = _mesh(reading.meshes[name], reading)
    weightless = "mass" in element.attributes and element.number("mass") == 0
    weightless = weightless or element.number("density", WATER) == 0
    own = NOTHING
    if not weightless:
        density_one = read_mesh(mesh, element.where)
        mass = _mass(element, density_one.mass)
        own = MassProperties(mass, density_one.com, density_one.inertia * (mass / density_one.mass))
    return Geom("mesh", (), placement, own.seen_from(*placement), group, colour, mesh)


def _mesh(asset: Element, reading: Reading) -> Mesh:
    """The file of a `<mesh>`."""
    for other in ("vertex", "builtin", "plugin"):
        if other in asset.attributes:
            raise InputError(f"{asset.where}: only meshes from files are read, not {other}=")
    name = str(Path(reading.settings.meshes) / asset.text("file"))
    path = file_within(reading.folder, name, asset)
    turn = asset.numbers("refquat", 4, (1, 0, 0, 0))
    rotation = quaternion_matrix(turn / nonzero(asset, "refquat", turn))
    base = Placement(asset.numbers("refpos", 3, np.zeros(3)), rotation)
    x, y, z = asset.numbers("scale", 3, np.ones(3))
    return Mesh(path, (float(x), float(y), float(z)), base)
