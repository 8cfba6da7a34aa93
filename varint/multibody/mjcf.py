"""Machines from MJCF, MuJoCo's files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.multibody.data import WORLD, Medium, Passive, Placement
from varint.multibody.elements import Element, Unread, document, located, words
from varint.multibody.mjcf_bodies import HERE, MjcfBody, MjcfJoint, bodies_of
from varint.multibody.mjcf_geoms import SIZES, Geom
from varint.multibody.mjcf_parts import Drive, add_drive, add_equalities, drives_of, reflected
from varint.multibody.mjcf_settings import Reading, defaults_of, included, settings_of
from varint.multibody.model import Model
from varint.multibody.names import new_name
from varint.multibody.parts import body_as_told, doubtful_moments
from varint.multibody.quantities import compose
from varint.multibody.rotations import axis_rotation, matrix_quaternion
from varint.multibody.shapes import GREY, Shape

READ = words("compiler option default worldbody asset actuator equality")
# pictures, memory, states to start from, measurements
HARMLESS = words("size visual statistic custom keyframe sensor contact")
ASSETS = words("mesh texture material hfield skin")


def from_mjcf(source: str | os.PathLike, *, folder: Any = None, creep: float = 1e-3) -> Model:
    """A machine from an MJCF file: bodies with any number of joints, closures, actuators.

    A body's joints move it one after the other in its own frame,
    ``X = X_body T(a₁) J₁(q₁) T(−a₁) T(a₂) J₂(q₂) T(−a₂) …``; a body without `<inertial>` weighs
    what its geoms weigh, as MuJoCo's compiler has it. Angles become rad. Free joints have the
    position and unit quaternion (w, x, y, z) of MuJoCo's ``qpos``, their rates are those of these
    seven numbers. Equality constraints hold exactly (MuJoCo's are soft). Contacts are not read.

    Parameters
    ----------
    source : str or path
        The file, or its text.
    folder : path, optional
        Where included files and meshes lie, here or beneath (default the file's folder).
    creep : float, optional
        Speed below which dry friction (``frictionloss``) turns over, see `Model`.

    Returns
    -------
    Model
        Actuators are its controls, their ``ctrlrange`` and the joints' ``range`` are in
        `Model.bounds`; sites are markers.

    Warns
    -----
    UserWarning
        Once, listing what was not used, with its lines; once, naming bodies with a principal moment
        that is larger than the sum of the others.

    Raises
    ------
    InputError
        If the file is malformed, leads out of its folder, or asks for something that would change
        the mechanics and is not read: tendons, flexible bodies, plugins, actuators with a state.

    References
    ----------
    MuJoCo documentation, XML reference and Computation, https://mujoco.readthedocs.io.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> text = '''<mujoco><worldbody><body name="rod">
    ...   <joint name="hinge" axis="0 1 0"/>
    ...   <geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05"/>
    ... </body></worldbody></mujoco>'''
    >>> rod = mb.from_mjcf(text)
    >>> rod.system(), round(rod.bodies["rod"].mass, 6)
    (System(q=[hinge]), 8.37758)
    """
    root, home = document(source, folder)
    if root.tag != "mujoco":
        raise InputError(f"{root.where}: an MJCF file begins with <mujoco>")
    reading = _reading(included(root, home), home)
    settings = reading.settings
    bodies = bodies_of(root, reading, WORLD)
    joints: dict[str, MjcfJoint] = {}
    for joint in (joint for body in bodies for joint in body.joints):
        if joint.name in joints:
            raise InputError(f"{joint.element.where}: there are two joints {joint.name!r}")
        joints[joint.name] = joint
    drives = drives_of(root, joints, reading)
    gravity = (0.0, 0.0, 0.0) if "gravity" in settings.off else settings.gravity
    model = Model(gravity, creep=creep)
    for body in bodies:
        _add_body(model, body, drives, reading)
    add_equalities(root, model, bodies, joints, reading)
    for drive in drives:
        add_drive(model, drive, joints)
    if (settings.density or settings.viscosity) and "passive" not in settings.off:
        model.machine.medium = Medium(settings.density, settings.viscosity, settings.wind)
    if touching(bodies):
        reading.unread.note(root, "contacts", "give the system contacts yourself")
    for said in (reading.unread.said(root.source), doubtful_moments(root.source, model.bodies)):
        if said:
            warnings.warn(said, stacklevel=2)
    return model


def _reading(root: Element, folder: Path | None) -> Reading:
    """What the file says about itself; sections that would change the mechanics are refused."""
    unread = Unread()
    for section in root:
        idle = section.tag == "tendon" and all(map(_idle, section))
        if section.tag not in READ and section.tag not in HARMLESS and not idle:
            raise InputError(
                f"{section.where} is not read: without it the mechanics would be another"
            )
        if section.tag == "tendon":
            unread.note(section, "", "no force of its own")
    settings, defaults = settings_of(root, unread), defaults_of(root)
    meshes: dict[str, Element] = {}
    for asset in (asset for section in root.all("asset") for asset in section):
        if asset.tag not in ASSETS:
            raise InputError(f"{asset.where}: assets of this kind are not read")
        if asset.tag == "mesh":
            mesh = defaults.applied(asset, None)
            name = mesh.attributes.get("name") or Path(mesh.attributes.get("file", "")).stem
            meshes[name] = mesh
    return Reading(settings, defaults, meshes, folder, unread)


def _idle(tendon: Element) -> bool:
    """Whether a tendon does nothing by itself."""
    does = ("stiffness", "damping", "frictionloss", "armature", "range", "limited", "class")
    return tendon.tag in ("fixed", "spatial") and not any(x in tendon.attributes for x in does)


def _add_body(model: Model, body: MjcfBody, drives: Sequence[Drive], reading: Reading) -> None:
    """A body, its joints with a body without mass between each two, and its sites."""
    if body.name != WORLD:
        mass = body.mass
        shapes = tuple(_shapes(body.geoms))
        model.bodies[body.name] = located(
            body.element,
            lambda: body_as_told(
                new_name("body", body.name, model.bodies), mass.mass, mass.com, mass.inertia, shapes
            ),
        )
        below, place = body.parent, body.placement
        free = any(joint.kind == "free" for joint in body.joints)
        if free and (len(body.joints) > 1 or body.parent != WORLD):
            raise InputError(
                f"{body.element.where}: a free joint is a body's only one, and the body stands in "
                "the world itself"
            )
        for i, joint in enumerate(body.joints):
            last = i == len(body.joints) - 1
            child = body.name if last else f"{body.name}/{joint.name}"
            if not last:
                model.body(name=child)
            _add_joint(model, joint, below, child, place, drives)
            below, place = child, HERE
        if not body.joints:
            model.fixed(body.parent, body.name, body.placement)
    for name, place in body.sites:
        if name in model.markers or name in model.bodies:
            name = f"{name} (site)"
        model.marker(body.name, place, name)


def _add_joint(
    model: Model,
    joint: MjcfJoint,
    parent: str,
    child: str,
    place: Placement,
    drives: Sequence[Drive],
) -> None:
    name, where = joint.name, joint.element.where
    stiffness, rest, damping = reflected(joint, drives)
    if joint.kind in ("free", "ball") and (joint.armature or stiffness or joint.friction):
        raise InputError(
            f"{where}: armature, stiffness and friction of a {joint.kind} joint are not read"
        )
    if joint.kind == "free":
        model.free(parent, child, HERE, name, damping=damping)
        turn = matrix_quaternion(place.rotation)
        model.machine.home[name] = np.concatenate([place.position, turn])
        return
    at = compose(place, Placement(joint.position, np.eye(3)))
    here = Placement(joint.position, np.eye(3))
    if joint.kind == "ball":
        model.spherical(parent, child, at, name, child_at=here, damping=damping)
        return
    model.machine.home[name] = np.array([joint.reference])
    axis = joint.axis / np.linalg.norm(joint.axis)
    if joint.kind == "hinge":
        start = Placement(np.zeros(3), axis_rotation(axis, -joint.reference))
    else:
        start = Placement(-joint.reference * axis, np.eye(3))
    make = model.revolute if joint.kind == "hinge" else model.prismatic
    make(
        parent,
        child,
        axis,
        compose(at, start),
        name,
        child_at=here,
        passive=Passive(joint.armature, damping, joint.friction, stiffness, rest),
        limits=joint.limits,
    )


def _shapes(geoms: Sequence[Geom]) -> Iterator[Shape]:
    """What is drawn of a body's geoms."""
    for geom in geoms:
        if geom.kind in SIZES or geom.mesh is not None:
            yield Shape(geom.kind, geom.size, geom.placement, geom.colour or GREY, geom.mesh)


def touching(bodies: Sequence[MjcfBody]) -> bool:
    """Whether geoms of two bodies that no joint joins could touch in MuJoCo."""
    parents = {body.name: body.parent for body in bodies}
    masks = [(body.name, geom.masks) for body in bodies for geom in body.geoms if any(geom.masks)]
    return any(
        (ours[0] & theirs[1]) or (theirs[0] & ours[1])
        for i, (a, ours) in enumerate(masks)
        for b, theirs in masks[:i]
        if a != b and (parents[a] != b or b == WORLD) and (parents[b] != a or a == WORLD)
    )
