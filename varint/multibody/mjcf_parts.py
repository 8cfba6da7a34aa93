"""Actuators and equality constraints of MJCF: what they do to joints, and what closes loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from varint.errors import InputError
from varint.multibody.data import WORLD, Anchor, Placement
from varint.multibody.elements import Element, words
from varint.multibody.mjcf_bodies import MjcfBody, MjcfJoint, span
from varint.multibody.mjcf_settings import ACTUATORS, Reading, boolean, chosen
from varint.multibody.model import Model
from varint.multibody.quantities import compose, inverse
from varint.multibody.rotations import frame_along, quaternion_matrix

COMMON = words(
    "name class group ctrllimited ctrlrange forcelimited forcerange gear joint jointinparent site "
    "lengthrange user info interp nsample actlimited actrange actearly inheritrange"
)
OWN = {
    "motor": (),
    "position": ("kp", "kv", "dampratio", "timeconst"),
    "velocity": ("kv",),
    "general": ("gaintype", "gainprm", "biastype", "biasprm", "dyntype", "dynprm", "actdim"),
}
EQUALITIES = ("connect", "weld", "joint")
NONE = (0.0, 0.0, 0.0)
HARMLESS_EQUALITY = ("name", "class", "active", "solref", "solimp", "info")


@dataclass(frozen=True)
class Drive:
    """An actuator: its force is ``gain u + bias[0] + bias[1] ℓ + bias[2] dℓ/dt``, ℓ = gear q."""

    name: str | None
    joint: str
    site: str
    gear: np.ndarray
    gain: float
    bias: tuple[float, float, float]
    limits: tuple[float, float]
    element: Element


def drives_of(root: Element, joints: Mapping[str, MjcfJoint], reading: Reading) -> list[Drive]:
    """All actuators of a file; those with a memory of their own are refused."""
    if "actuation" in reading.settings.off:
        return []
    return [
        _drive(reading.defaults.applied(element, None), joints, reading)
        for section in root.all("actuator")
        for element in section
    ]


def _drive(element: Element, joints: Mapping[str, MjcfJoint], reading: Reading) -> Drive:
    if element.tag not in OWN:
        known = "a kind with a state of its own" if element.tag in ACTUATORS else "an unknown kind"
        raise InputError(
            f"{element.where} is {known} of actuator, which is not read; known: {list(OWN)}"
        )
    attributes = element.attributes
    for name in attributes:
        if name not in COMMON and name not in OWN[element.tag]:
            raise InputError(f"{element.where}: {name} is not read; it would change the mechanics")
    targets = [name for name in ("joint", "jointinparent", "site") if name in attributes]
    if len(targets) != 1:
        raise InputError(f"{element.where} must name one joint or one site, got {targets}")
    gear = np.array([1.0, 0, 0, 0, 0, 0])
    given = element.numbers("gear", None, (1.0,), most=6)
    gear[: len(given)] = given
    joint = attributes.get("joint", attributes.get("jointinparent", ""))
    if targets != ["site"] and joint not in joints:
        raise InputError(f"{element.where}: there is no joint {joint!r}")
    gain, bias = _law(element)
    lower, upper = span(element, "ctrlrange", "ctrllimited", reading.settings)
    if (share := element.number("inheritrange", 0.0)) > 0 and joint:
        low, high = joints[joint].limits[:2]
        lower, upper = (
            ((low + high) - share * (high - low)) / 2,
            ((low + high) + share * (high - low)) / 2,
        )
    weakest, strongest = span(element, "forcerange", "forcelimited", reading.settings)
    if np.isfinite(strongest - weakest):
        if any(bias) or gain <= 0:
            reading.unread.note(element, "forcerange", "bound the force in the problem itself")
        else:
            lower, upper = max(lower, weakest / gain), min(upper, strongest / gain)
    return Drive(
        attributes.get("name"),
        joint,
        attributes.get("site", ""),
        gear,
        gain,
        bias,
        (lower, upper),
        element,
    )


def _law(element: Element) -> tuple[float, tuple[float, float, float]]:
    """Gain and bias of an actuator."""
    if element.tag == "motor":
        return 1.0, (0.0, 0.0, 0.0)
    if element.tag == "velocity":
        kv = element.number("kv", 1.0)
        return kv, (0.0, 0.0, -kv)
    if element.tag == "position":
        for name in ("dampratio", "timeconst"):
            if element.number(name, 0.0) != 0:
                raise InputError(f"{element.where}: {name} is not read; give kv")
        kp = element.number("kp", 1.0)
        return kp, (0.0, -kp, -element.number("kv", 0.0))
    if element.attributes.get("dyntype", "none") != "none":
        raise InputError(f"{element.where}: actuators with a state of their own are not read")
    gain = element.numbers("gainprm", None, (1.0,), most=10)
    bias = element.numbers("biasprm", None, (0.0,), most=10)
    kinds = {"none": 0, "fixed": 1, "affine": 3}
    kinds_known = {name: kinds[name] for name in ("fixed", "affine")}
    count = chosen(element, "gaintype", kinds_known) if "gaintype" in element.attributes else 1
    if np.any(gain[1:count] != 0):
        raise InputError(f"{element.where}: a gain that depends on the motion is not read")
    kinds_known = {name: kinds[name] for name in ("none", "affine")}
    count = chosen(element, "biastype", kinds_known) if "biastype" in element.attributes else 0
    law = np.zeros(3)
    law[: min(count, len(bias))] = bias[:count]
    return float(gain[0]), (float(law[0]), float(law[1]), float(law[2]))


def reflected(joint: MjcfJoint, drives: Sequence[Drive]) -> tuple[float, float, float]:
    """Stiffness, rest and damping of a joint with what its drives add: gear² kp, gear² kv."""
    stiffness, moment, damping = joint.stiffness, joint.stiffness * joint.rest, joint.damping
    for drive in drives:
        if drive.joint != joint.name:
            continue
        gear, (constant, along, fast) = drive.gear[0], drive.bias
        stiffness -= gear**2 * along
        moment += gear * constant
        damping -= gear**2 * fast
    if stiffness < 0 or damping < 0 or (stiffness == 0 and moment != 0):
        raise InputError(
            f"{joint.element.where}: its actuators push it by a constant or drive it away; only "
            "those that hold it like a spring and damper are read"
        )
    return stiffness, moment / stiffness if stiffness else 0.0, damping


def add_drive(model: Model, drive: Drive, joints: Mapping[str, MjcfJoint]) -> None:
    """The control of an actuator."""
    where = drive.element.where
    name = drive.name or f"{drive.joint or drive.site}_u"
    if name in {x for joint in model.joints.values() for x in joint.coordinates}:
        name = f"{name}_u"  # many files call a motor like its joint
    if drive.joint:
        if joints[drive.joint].kind not in ("hinge", "slide"):
            raise InputError(f"{where}: only hinges and slides take motors; push on a site")
        gear = drive.gain * drive.gear[0]
        model.motor(drive.joint, name, gear=gear, limits=drive.limits)
        return
    if drive.site not in model.markers:
        raise InputError(f"{where}: there is no site {drive.site!r}")
    anchor = model.markers[drive.site]
    force, torque = drive.gear[:3], drive.gear[3:]
    if force.any() == torque.any() or any(drive.bias):
        raise InputError(f"{where}: at a site, a force or a torque is read, not both, and no bias")
    kind, direction = ("thrust", force) if force.any() else ("torque", torque)
    size = float(np.linalg.norm(direction))
    turn = Placement(np.zeros(3), frame_along(direction / size))
    frame = Anchor(anchor.body, compose(anchor.placement, turn))
    model.thrust(
        frame,
        name,
        gear=drive.gain * size,
        limits=drive.limits,
        kind=kind,
    )


def add_equalities(
    root: Element,
    model: Model,
    bodies: Sequence[MjcfBody],
    joints: Mapping[str, MjcfJoint],
    reading: Reading,
) -> None:
    """Loops and couplings; MuJoCo holds them softly, here they hold exactly."""
    if "equality" in reading.settings.off:
        return
    places = {WORLD: Placement(np.zeros(3), np.eye(3))}
    for body in bodies:
        if body.name not in places:
            places[body.name] = compose(places[body.parent], body.placement)
    for section in root.all("equality"):
        for element in section:
            applied = reading.defaults.applied(element, None, "equality")
            if not boolean(applied, "active", True):
                continue
            if applied.tag not in EQUALITIES:
                raise InputError(f"{applied.where} is none of the equalities {list(EQUALITIES)}")
            if applied.tag == "joint":
                _coupling(applied, model, joints, reading)
            else:
                _closure(applied, model, places, reading)


def _coupling(
    element: Element, model: Model, joints: Mapping[str, MjcfJoint], reading: Reading
) -> None:
    """q₁ − ref₁ = Σ cₖ (q₂ − ref₂)ᵏ, multiplied out."""
    reading.unread.only(element, (), ["joint1", "joint2", "polycoef", *HARMLESS_EQUALITY])
    if "joint2" not in element.attributes:
        raise InputError(f"{element.where} locks its joint; leave the joint out instead")
    names = [element.text(name) for name in ("joint1", "joint2")]
    if unknown := [name for name in names if name not in joints]:
        raise InputError(f"{element.where}: there are no joints {unknown}")
    follower, leader = (joints[name] for name in names)
    given = element.numbers("polycoef", None, (0.0, 1.0), most=5)
    moved = np.polynomial.Polynomial(given)(np.polynomial.Polynomial([-leader.reference, 1.0]))
    coefficients = np.append(moved.coef, np.zeros(max(0, 2 - len(moved.coef))))
    coefficients[0] += follower.reference
    used = max(2, 1 + int(np.flatnonzero(coefficients)[-1])) if coefficients.any() else 2
    model.couple(follower.name, leader.name, [float(c) for c in coefficients[:used]])


def _closure(
    element: Element, model: Model, places: Mapping[str, Placement], reading: Reading
) -> None:
    """Two points that coincide, or two frames."""
    own = ["body1", "body2", "site1", "site2", "anchor", "relpose", "torquescale"]
    reading.unread.only(element, (), [*own, *HARMLESS_EQUALITY])
    kind = "point" if element.tag == "connect" else "weld"
    name = element.attributes.get("name")
    if kind == "weld" and element.number("torquescale", 1.0) == 0:
        raise InputError(f"{element.where}: a weld without torque is a <connect>")
    if "site1" in element.attributes:
        sites = [element.text(which) for which in ("site1", "site2")]
        if unknown := [site for site in sites if site not in model.markers]:
            raise InputError(f"{element.where}: there are no sites {unknown}")
        one, other = (model.markers[site] for site in sites)
        model.loop(kind, one, other, name)
        return
    first, second = element.text("body1"), element.attributes.get("body2", WORLD)
    if unknown := [body for body in (first, second) if body not in places]:
        raise InputError(f"{element.where}: there are no bodies {unknown}")
    relative = compose(inverse(places[first]), places[second])  # of the second in the first
    anchor = Placement(element.numbers("anchor", 3, None if kind == "point" else NONE), np.eye(3))
    if kind == "point":
        there = compose(inverse(relative), anchor)
        model.loop(kind, Anchor(first, anchor), Anchor(second, there), name)
        return
    pose = element.numbers("relpose", 7, (0, 1, 0, 0, 0, 0, 0))
    if pose[3:].any():
        turn = quaternion_matrix(pose[3:] / np.linalg.norm(pose[3:]))
        frames = Placement(pose[:3], turn), anchor
    else:  # as they stand at rest
        frames = compose(relative, anchor), anchor
    model.loop(kind, Anchor(first, frames[0]), Anchor(second, frames[1]), name)
