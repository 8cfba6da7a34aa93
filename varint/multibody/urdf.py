"""Robots from URDF files: links and joints."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.multibody.data import WORLD, Limits, Passive
from varint.multibody.elements import Element, Unread, document, located
from varint.multibody.model import Model
from varint.multibody.names import new_name
from varint.multibody.parts import body_as_told, doubtful_moments
from varint.multibody.shapes import Shape
from varint.multibody.urdf_shapes import NONE, link_shapes, origin

KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# what controllers and pictures need, and the motion does not
HARMLESS = ("calibration", "safety_controller", "collision", "material", "verbose", "contact")


def from_urdf(
    source: str | os.PathLike,
    *,
    base: str = "fixed",
    motors: Sequence[str] | str = (),
    folder: Any = None,
    gravity: Any = (0.0, 0.0, -9.81),
    creep: float = 1e-3,
) -> Model:
    """A robot from a URDF file: links become bodies, joints joints, `<mimic>` couplings.

    A joint's frame stands in its parent link at ``R = R_z(yaw) R_y(pitch) R_x(roll)``, the child
    link's frame is the joint's. The order of the coordinates is that of the joints in the file.

    Parameters
    ----------
    source : str or path
        The file, or its text.
    base : {"fixed", "free"}, optional
        Whether the root link is fixed to the ground or floats (joint ``base``: position and unit
        quaternion). A root link called world is the ground itself.
    motors : sequence of str or "all", optional
        Joints that a control acts upon, ``<joint>_u``, bounded by the effort of its `<limit>`.
    folder : path, optional
        Where meshes may lie, and packages of ``package://``: here or beneath, nowhere else (default
        the file's folder). A mesh that is not found there is not drawn.
    gravity : array (3,), optional
    creep : float, optional
        Speed below which dry friction turns over, see `Model`.

    Returns
    -------
    Model
        `Model.system` is its scene; limits of position and speed are in `Model.bounds`.

    Warns
    -----
    UserWarning
        Once, listing what was not used, with its lines; once, naming links with a principal moment
        that is larger than the sum of the others.

    Raises
    ------
    InputError
        If the file is missing, too large or malformed, holds a document type, or describes no tree
        of links; the message names the line.

    References
    ----------
    ROS, URDF XML specification, http://wiki.ros.org/urdf/XML.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> text = '''<robot name="pendulum">
    ...   <link name="ceiling"/>
    ...   <link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
    ...     <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    ...   <joint name="hinge" type="continuous"><parent link="ceiling"/><child link="rod"/>
    ...     <axis xyz="0 1 0"/></joint>
    ... </robot>'''
    >>> mb.from_urdf(text).system()
    System(q=[hinge])
    """
    if base not in ("fixed", "free"):
        raise InputError(f'base must be "fixed" or "free", got {base!r}')
    root, home = document(source, folder)
    if root.tag != "robot":
        raise InputError(f"{root.where}: a URDF file begins with <robot>")
    unread = Unread()
    unread.only(root, ("link", "joint", *HARMLESS), ("name", "version"))
    links, joints = _named(root, "link"), _named(root, "joint")
    ground = root_link(root, links, joints)
    model = Model(gravity, creep=creep)
    colours = {
        material.attributes["name"]: material
        for material in root.all("material")
        if "name" in material.attributes
    }
    if WORLD in links and ground != WORLD:
        raise InputError(f"{links[WORLD].where}: only the root link may be called {WORLD!r}")
    for name, link in links.items():
        if name != WORLD:
            _body(model, link, link_shapes(link, colours, home, unread), unread)
    if ground != WORLD:
        {"fixed": model.fixed, "free": model.free}[base](model, ground, name="base")
    elif base == "free":
        raise InputError(f"{links[WORLD].where}: a root link called {WORLD!r} cannot float")
    for joint in joints.values():
        _joint(model, joint, unread)
    for joint in joints.values():
        _mimic(model, joint, unread)
    for name in _driven(model, motors):
        model.motor(name)
    for said in (unread.said(root.source), doubtful_moments(root.source, model.bodies)):
        if said:
            warnings.warn(said, stacklevel=2)
    return model


def _driven(model: Model, motors: Sequence[str] | str) -> list[str]:
    """The joints that get a motor: "all" those of one coordinate that lead."""
    if motors != "all":
        return [motors] if isinstance(motors, str) else list(motors)
    kinds = ("revolute", "prismatic")
    return [joint.name for joint in model.machine.moving if joint.kind in kinds]


def _mimic(model: Model, joint: Element, unread: Unread) -> None:
    """The coupling of a joint that follows another; what is fixed follows nothing."""
    mimic = joint.one("mimic")
    if mimic is None:
        return
    if joint.text("type") == "fixed":
        unread.note(mimic, "", "of a fixed joint")
        return
    leader = mimic.text("joint")
    multiplier, offset = mimic.number("multiplier", 1.0), mimic.number("offset", 0.0)
    located(mimic, lambda: model.mimic(joint.text("name"), leader, multiplier, offset))


def _named(root: Element, tag: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.text("name")
        if name in found:
            raise InputError(
                f"{element.where} stands on line {found[name].line} already; names are unique"
            )
        found[name] = element
    return found


def root_link(root: Element, links: dict[str, Element], joints: dict[str, Element]) -> str:
    """The one link that no joint leads to."""
    children: dict[str, Element] = {}
    for joint in joints.values():
        ends = joint_ends(joint)
        if unknown := [end for end in ends if end not in links]:
            raise InputError(f"{joint.where}: there is no link {unknown[0]!r}")
        child = ends[1]
        if child in children:
            raise InputError(
                f"{joint.where} leads to link {child!r}, and so does line {children[child].line}; "
                "URDF has no closed loops: close it by model.loop(…)"
            )
        children[child] = joint
    roots = [name for name in links if name not in children]
    if not links:
        raise InputError(f"{root.where} has no links")
    if len(roots) != 1:
        what = (
            f"has {len(roots)} links that no joint leads to: {roots[:5]}" if roots else "is a ring"
        )
        raise InputError(f"{root.where} {what}; the links must form one tree")
    return roots[0]


def joint_ends(joint: Element) -> tuple[str, str]:
    """The links that a joint joins, parent and child."""
    parent, child = joint.one("parent"), joint.one("child")
    if parent is None or child is None:
        raise InputError(f"{joint.where} needs a <parent link=…> and a <child link=…>")
    return parent.text("link"), child.text("link")


def _body(model: Model, link: Element, shapes: tuple[Shape, ...], unread: Unread) -> None:
    mass, com, inertia = _inertial(link, unread)
    name = link.text("name")
    model.bodies[name] = located(
        link, lambda: body_as_told(new_name("body", name, model.bodies), mass, com, inertia, shapes)
    )


def _inertial(link: Element, unread: Unread) -> tuple[float, Any, Any]:
    """Mass, centre of mass, and inertia about it along the link's axes."""
    unread.only(link, ("inertial", "visual", *HARMLESS), ("name", "type"))
    inertial = link.one("inertial")
    if inertial is None:
        return 0.0, NONE, 0.0
    unread.only(inertial, ("origin", "mass", "inertia"), ())
    mass, inertia = inertial.one("mass"), inertial.one("inertia")
    if mass is None or inertia is None:
        raise InputError(f"{inertial.where} needs a <mass> and an <inertia>")
    place, value = origin(inertial), mass.number("value")
    entries = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (inertia.number(name) for name in entries)
    if value < 0:
        raise InputError(f"{mass.where}: the mass {value:g} is negative")
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    turned = place.rotation @ matrix @ place.rotation.T
    return value, place.position, (turned + turned.T) / 2


def _joint(model: Model, element: Element, unread: Unread) -> None:
    parts = ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic")
    unread.only(element, (*parts, *HARMLESS), ("name", "type"))
    kind, name = element.text("type"), element.text("name")
    if kind not in KINDS:
        raise InputError(f"{element.where}: type={kind!r} is none of {list(KINDS)}")
    parent, child = joint_ends(element)
    at = origin(element)
    damping = friction = 0.0
    if (dynamics := element.one("dynamics")) is not None:
        damping, friction = dynamics.number("damping", 0.0), dynamics.number("friction", 0.0)
        if damping < 0 or friction < 0:
            raise InputError(f"{dynamics.where} of joint {name!r}: damping and friction are ≥ 0")
    if kind == "fixed":
        located(element, lambda: model.fixed(parent, child, at, name))
    elif kind == "floating":
        located(element, lambda: model.free(parent, child, at, name, damping=damping))
    elif kind == "planar":
        normal = _axis(element)
        located(element, lambda: model.planar(parent, child, normal, at, name, damping=damping))
    else:
        make = model.prismatic if kind == "prismatic" else model.revolute
        limits, passive = _limits(element, kind, unread), Passive(0.0, damping, friction)
        axis = _axis(element)
        located(
            element,
            lambda: make(parent, child, axis, at, name, passive=passive, limits=limits),
        )


def _axis(joint: Element) -> np.ndarray:
    axis = joint.one("axis")
    value = np.array([1.0, 0, 0]) if axis is None else axis.numbers("xyz", 3, (1.0, 0, 0))
    if not value.any():
        raise InputError(f"{joint.where}: its axis is zero")
    return value


def _limits(joint: Element, kind: str, unread: Unread) -> Limits:
    """The `<limit>` of a joint; zero speed and effort are what files say that know none."""
    limit = joint.one("limit")
    if limit is None:
        return Limits()
    speed, effort = limit.number("velocity", 0.0), limit.number("effort", 0.0)
    lower, upper = limit.number("lower", 0.0), limit.number("upper", 0.0)
    if lower > upper or speed < 0 or effort < 0:
        raise InputError(f"{limit.where} of joint {joint.text('name')!r} excludes every motion")
    for name, value in (("velocity", speed), ("effort", effort)):
        if name in limit.attributes and value == 0:
            unread.note(limit, f"{name}=0", "read as no limit")
    free = kind == "continuous"
    return Limits(
        -np.inf if free else lower, np.inf if free else upper, speed or np.inf, effort or np.inf
    )
