"""The tree of an MJCF file: bodies, several joints each, their inertia, sites."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from varint.errors import InputError
from varint.multibody.data import Limits, Placement
from varint.multibody.elements import Element, Unread, words
from varint.multibody.mjcf_geoms import Geom, geom_of, placement_of
from varint.multibody.mjcf_settings import ORIENTATIONS, Reading, Settings, boolean, chosen
from varint.multibody.quantities import compose
from varint.multibody.solids import MassProperties, joined

HERE = Placement(np.zeros(3), np.eye(3))
BODY = words("name childclass pos user gravcomp mocap sleep simple fuse info")
IN_BODY = words("inertial joint freejoint geom site body frame camera light")
JOINT = words(
    "name class type pos axis ref range limited armature damping stiffness springref frictionloss "
    "actuatorfrcrange actuatorfrclimited springdamper springyield actuatorgravcomp align group "
    "user margin solreflimit solimplimit solreffriction solimpfriction info"
)


@dataclass(frozen=True, eq=False)
class MjcfJoint:
    """A joint in its body's frame; angles in rad."""

    name: str
    kind: str  # free, ball, slide, hinge
    position: np.ndarray
    axis: np.ndarray
    reference: float
    rest: float
    armature: float
    damping: float
    stiffness: float
    friction: float
    limits: Limits
    element: Element


@dataclass(frozen=True, eq=False)
class MjcfBody:
    """A body of the file, in its parent's frame."""

    name: str
    parent: str
    placement: Placement
    joints: tuple[MjcfJoint, ...]
    mass: MassProperties
    geoms: tuple[Geom, ...]
    sites: tuple[tuple[str, Placement], ...]
    element: Element


def bodies_of(root: Element, reading: Reading, world: str) -> list[MjcfBody]:
    """All bodies, the ground first (once for each `<worldbody>`), parents before children."""
    found: list[MjcfBody] = []
    taken = {world}

    def read(element: Element, name: str, parent: str, outer: Placement, cls: str | None) -> None:
        cls = element.attributes.get("childclass", cls)
        items = list(_items(element, HERE, cls, reading))
        place = compose(outer, placement_of(element, reading.settings))
        found.append(_body(element, name, parent, place, items, reading))
        for item, inner, inner_class in items:
            if item.tag == "body":
                child = item.attributes.get("name") or f"body{len(taken)}"
                if child in taken:
                    raise InputError(f"{item.where}: there are two bodies {child!r}")
                taken.add(child)
                read(item, child, name, inner, inner_class)

    for section in root.all("worldbody"):
        read(section, world, "", HERE, None)
    return scaled(found, reading.settings.total_mass, world)


def scaled(bodies: list[MjcfBody], total: float, world: str) -> list[MjcfBody]:
    """Masses and inertias brought to a total mass, where one is given."""
    sum_of_masses = sum(body.mass.mass for body in bodies if body.name != world)
    if total <= 0 or sum_of_masses == 0:
        return bodies
    factor = total / sum_of_masses
    return [
        replace(
            body,
            mass=MassProperties(factor * body.mass.mass, body.mass.com, factor * body.mass.inertia),
        )
        for body in bodies
    ]


Item = tuple[Element, Placement, str | None]


def _items(element: Element, outer: Placement, cls: str | None, reading: Reading) -> Iterator[Item]:
    """What a body holds, with the frame and the class that it stands in; `<frame>`s are opened."""
    for child in element:
        if child.tag not in IN_BODY:
            raise InputError(
                f"{child.where} is not read: without it the mechanics would be another"
            )
        if child.tag == "frame":
            reading.unread.only(child, IN_BODY, ["name", "pos", "childclass", *ORIENTATIONS])
            inner = compose(outer, placement_of(child, reading.settings))
            inner_class = child.attributes.get("childclass", cls)
            yield from _items(child, inner, inner_class, reading)
        elif child.tag not in ("camera", "light"):
            has_class = child.tag in ("joint", "geom", "site")
            yield reading.defaults.applied(child, cls) if has_class else child, outer, cls


def _body(
    element: Element,
    name: str,
    parent: str,
    place: Placement,
    items: Sequence[Item],
    reading: Reading,
) -> MjcfBody:
    reading.unread.only(element, IN_BODY, [*BODY, *ORIENTATIONS])
    if boolean(element, "mocap"):
        raise InputError(f"{element.where}: a body moved by motion capture is not read")
    if element.number("gravcomp", 0.0) != 0:
        raise InputError(f"{element.where}: gravcomp is not read; it would change the mechanics")
    geoms = [geom_of(item, outer, reading) for item, outer, _ in items if item.tag == "geom"]
    joints = [
        _joint(item, outer, reading)
        for item, outer, _ in items
        if item.tag in ("joint", "freejoint")
    ]
    for i, joint in enumerate(joints):
        if not joint.name:
            number = f"{i + 1}" if len(joints) > 1 else ""
            joints[i] = replace(joint, name=f"{name}_joint{number}")
    sites = [
        (item.attributes.get("name", ""), compose(outer, placement_of(item, reading.settings)))
        for item, outer, _ in items
        if item.tag == "site"
    ]
    inertial = element.one("inertial")
    mass = _mass(inertial, geoms, reading.settings, reading.unread)
    return MjcfBody(
        name,
        parent,
        place,
        tuple(joints),
        mass,
        tuple(geoms),
        tuple(site for site in sites if site[0]),
        element,
    )


def _mass(
    inertial: Element | None, geoms: Sequence[Geom], settings: Settings, unread: Unread
) -> MassProperties:
    """What a body weighs: as `<inertial>` says, or its geoms; then the compiler's bounds."""
    low, high = settings.groups
    of_geoms = joined([geom.mass for geom in geoms if low <= geom.group <= high])
    way = settings.inertia_from_geoms
    if inertial is None or (way == "true" and of_geoms.mass > 0):
        mass = of_geoms if way != "false" else joined([])
    else:
        mass = _inertial(inertial, settings, unread)
    if settings.least_mass or settings.least_inertia or settings.balance:
        moments, axes = np.linalg.eigh(mass.inertia)
        moments = np.maximum(moments, settings.least_inertia)
        if settings.balance and moments[0] + moments[1] < moments[2]:
            moments[:] = moments.mean()
        inertia = axes @ np.diag(moments) @ axes.T
        mass = MassProperties(max(mass.mass, settings.least_mass), mass.com, inertia)
    return mass


def _inertial(element: Element, settings: Settings, unread: Unread) -> MassProperties:
    unread.only(element, (), ["pos", "mass", "diaginertia", "fullinertia", *ORIENTATIONS])
    place = placement_of(element, settings)
    full = element.optional("fullinertia", 6)
    if (full is None) == ("diaginertia" not in element.attributes):
        raise InputError(f"{element.where} needs diaginertia or fullinertia, and one of them only")
    if full is not None:
        if any(name in element.attributes for name in ORIENTATIONS):
            raise InputError(f"{element.where}: fullinertia has an orientation already")
        xx, yy, zz, xy, xz, yz = full
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        diagonal = np.diag(element.numbers("diaginertia", 3))
        inertia = place.rotation @ diagonal @ place.rotation.T
    mass = element.number("mass")
    if mass < 0 or np.linalg.eigvalsh(inertia)[0] < 0:
        raise InputError(f"{element.where} has a negative mass or moment of inertia")
    return MassProperties(mass, place.position, inertia)


def _joint(element: Element, outer: Placement, reading: Reading) -> MjcfJoint:
    settings = reading.settings
    reading.unread.only(element, (), JOINT)
    kinds = {word: word for word in ("free", "ball", "slide", "hinge")}
    kind = "hinge" if element.tag == "joint" else "free"
    if "type" in element.attributes and element.tag == "joint":
        kind = chosen(element, "type", kinds)
    for name in ("springdamper", "springyield"):
        if element.numbers(name, None, (0.0,), most=2).any():
            raise InputError(f"{element.where}: {name} is not read; it would change the mechanics")
    axis = element.numbers("axis", 3, (0, 0, 1))
    if np.linalg.norm(axis) == 0:
        raise InputError(f"{element.where}: its axis is zero")
    unit = settings.angle if kind in ("hinge", "ball") else 1.0
    turn = settings.angle if kind == "hinge" else 1.0
    position = element.numbers("pos", 3, np.zeros(3))
    return MjcfJoint(
        element.attributes.get("name", ""),
        kind,
        outer.position + outer.rotation @ position,
        outer.rotation @ axis,
        element.number("ref", 0.0) * turn,
        element.number("springref", 0.0) * turn,
        element.number("armature", 0.0),
        0.0 if settings.off & {"damper", "passive"} else first(element, "damping"),
        0.0 if settings.off & {"spring", "passive"} else first(element, "stiffness"),
        0.0 if "frictionloss" in settings.off else element.number("frictionloss", 0.0),
        _limits(element, unit, settings),
        element,
    )


def first(element: Element, name: str) -> float:
    """A coefficient; those of higher powers must vanish."""
    values = element.numbers(name, None, (0.0,), most=8)
    if np.any(values[1:] != 0):
        raise InputError(
            f"{element.where}: {name}={element.attributes[name]!r} is not linear; that is not read"
        )
    return float(values[0])


def _limits(element: Element, unit: float, settings: Settings) -> Limits:
    """The range of the coordinate, and of the forces that actuators put on it."""
    lower, upper = span(element, "range", "limited", settings, unit)
    weakest, strongest = span(element, "actuatorfrcrange", "actuatorfrclimited", settings)
    return Limits(lower, upper, effort=max(-weakest, strongest))


def span(
    element: Element, name: str, flag: str, settings: Settings, unit: float = 1.0
) -> tuple[float, float]:
    """A range, infinite where it does not hold."""
    values = element.optional(name, 2)
    word = element.attributes.get(flag, "auto")
    if word not in ("auto", "true", "false"):
        raise InputError(f"{element.where}: {flag}={word!r} is none of true, false, auto")
    if word == "true" and values is None:
        raise InputError(f"{element.where}: {flag} without {name}")
    if values is None or word == "false" or (word == "auto" and not settings.autolimits):
        return -np.inf, np.inf
    if word == "auto" and not values.any():
        return -np.inf, np.inf
    if values[0] >= values[1]:
        raise InputError(f"{element.where}: {name}={element.attributes[name]!r} is empty")
    return float(values[0] * unit), float(values[1] * unit)
