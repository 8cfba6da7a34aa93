"""What an MJCF file says about itself: includes, defaults, the compiler's conventions, options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from varint.errors import InputError
from varint.multibody.elements import Element, Unread, contents, file_within, root_element, words

# attributes that may be shorter than those of the default that they overwrite in part
IN_PARTS = ("size", "gear")
COMPILER = words(
    "angle autolimits eulerseq inertiafromgeom inertiagrouprange boundmass boundinertia "
    "balanceinertia settotalmass meshdir assetdir coordinate"
)
# these concern pictures, contacts, files written, or the speed of a solver
HARMLESS_COMPILER = words(
    "texturedir strippath discardvisual usethread fusestatic saveinertial fitaabb alignfree "
    "conflict passthrough savecompiled savecanonical"
)
HARMLESS_OPTION = words(
    "timestep integrator solver iterations tolerance ls_iterations ls_tolerance noslip_iterations "
    "noslip_tolerance ccd_iterations ccd_tolerance sdf_iterations sdf_initpoints cone jacobian "
    "impratio o_margin o_solref o_solimp o_friction apirate actuatorgroupdisable sleep_tolerance "
    "mpr_iterations mpr_tolerance"
)
FLAGS = ("gravity", "spring", "damper", "passive", "equality", "frictionloss", "actuation", "limit")
HARMLESS_FLAGS = words(
    "contact constraint clampctrl warmstart filterparent refsafe sensor midphase nativeccd "
    "eulerdamp autoreset override energy fwdinv invdiscrete multiccd island sleep"
)


@dataclass(frozen=True)
class Settings:
    """How the rest of a file is to be read."""

    degrees: bool = True
    sequence: str = "xyz"
    autolimits: bool = True
    inertia_from_geoms: str = "auto"
    groups: tuple[int, int] = (0, 5)
    least_mass: float = 0.0
    least_inertia: float = 0.0
    balance: bool = False
    total_mass: float = -1.0
    meshes: str = ""
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    density: float = 0.0
    viscosity: float = 0.0
    wind: tuple[float, ...] = (0.0, 0.0, 0.0)
    off: frozenset[str] = frozenset()

    @property
    def angle(self) -> float:
        """Radians of one unit of the file's angles."""
        return np.pi / 180 if self.degrees else 1.0


def settings_of(root: Element, unread: Unread) -> Settings:
    """The conventions of `<compiler>` and the physics of `<option>`; later ones overwrite."""
    settings = Settings()
    for section in root.all("compiler"):
        settings = _compiler(section, settings, unread)
    for section in root.all("option"):
        settings = _option(section, settings, unread)
    return settings


def _compiler(section: Element, settings: Settings, unread: Unread) -> Settings:
    unread.only(section, ("lengthrange",), [*COMPILER, *HARMLESS_COMPILER])
    given: dict[str, Any] = {}
    attributes = section.attributes
    if attributes.get("coordinate", "local") != "local":
        raise InputError(f"{section.where}: only local coordinates are read, as in MuJoCo itself")
    if "angle" in attributes:
        given["degrees"] = chosen(section, "angle", {"degree": True, "radian": False})
    for name, key in (("autolimits", "autolimits"), ("balanceinertia", "balance")):
        if name in attributes:
            given[key] = boolean(section, name)
    if "eulerseq" in attributes:
        given["sequence"] = section.text("eulerseq")
        if len(given["sequence"]) != 3 or set(given["sequence"].lower()) - set("xyz"):
            raise InputError(f"{section.where}: eulerseq must be three of xyzXYZ")
    if "inertiafromgeom" in attributes:
        ways = {way: way for way in ("false", "true", "auto")}
        given["inertia_from_geoms"] = chosen(section, "inertiafromgeom", ways)
    if "inertiagrouprange" in attributes:
        given["groups"] = tuple(map(int, section.numbers("inertiagrouprange", 2)))
    for name, key in (
        ("boundmass", "least_mass"),
        ("boundinertia", "least_inertia"),
        ("settotalmass", "total_mass"),
    ):
        if name in attributes:
            given[key] = section.number(name)
    for name in ("assetdir", "meshdir"):
        if name in attributes:
            given["meshes"] = section.text(name)
    return replace(settings, **given)


def _option(section: Element, settings: Settings, unread: Unread) -> Settings:
    physics = ("gravity", "density", "viscosity", "wind")
    unread.only(section, ("flag",), [*physics, *HARMLESS_OPTION, "magnetic"])
    given: dict[str, Any] = {}
    for name in ("gravity", "wind"):
        if name in section.attributes:
            given[name] = tuple(section.numbers(name, 3))
    for name in ("density", "viscosity"):
        if name in section.attributes:
            given[name] = section.number(name)
    off = set(settings.off)
    for flags in section.all("flag"):
        unread.only(flags, (), [*FLAGS, *HARMLESS_FLAGS])
        for name in FLAGS:
            if name in flags.attributes:
                is_on = chosen(flags, name, {"enable": True, "disable": False})
                off = off - {name} if is_on else off | {name}
    return replace(settings, off=frozenset(off), **given)


def chosen(element: Element, name: str, meanings: Mapping[str, Any]) -> Any:
    """What one of several words stands for."""
    word = element.text(name)
    if word not in meanings:
        raise InputError(f"{element.where}: {name}={word!r} is none of {list(meanings)}")
    return meanings[word]


def boolean(element: Element, name: str, default: bool = False) -> bool:
    """An attribute that is true or false."""
    if name not in element.attributes:
        return default
    return bool(chosen(element, name, {"true": True, "false": False}))


def included(root: Element, folder: Path | None) -> Element:
    """The document with every `<include file=…>` replaced by what the file's root holds."""
    seen: set[Path] = set()

    def expand(element: Element) -> None:
        children: list[Element] = []
        for child in element.children:
            if child.tag != "include":
                expand(child)
                children.append(child)
                continue
            name = child.text("file")
            path = file_within(folder, name, child)
            if path in seen:
                raise InputError(f"{child.where}: {name!r} is included twice")
            seen.add(path)
            inner = root_element(contents(path), name)
            expand(inner)
            children.extend(inner.children)
        element.children[:] = children

    expand(root)
    return root


@dataclass(frozen=True)
class Defaults:
    """Attributes of elements that do not give them, by class and tag."""

    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=lambda: {"main": {}})

    def applied(self, element: Element, childclass: str | None, tag: str = "") -> Element:
        """The element with the attributes of its class, of the body's or of the main one."""
        name = element.attributes.get("class", childclass or "main")
        if name not in self.classes:
            raise InputError(
                f"{element.where}: unknown class {name!r}; known: {sorted(self.classes)}"
            )
        tag = tag or ("actuator" if element.tag in ACTUATORS else element.tag)
        attributes = merged(self.classes[name].get(tag, {}), element.attributes)
        return replace(element, attributes=attributes)


# one set of defaults for actuators of any kind
ACTUATORS = words(
    "general motor position velocity intvelocity damper cylinder muscle adhesion dcmotor plugin"
)
# ways to give one orientation or one place: the element's own takes the default's place
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")


def merged(old: Mapping[str, str], new: Mapping[str, str]) -> dict[str, str]:
    """Attributes that overwrite others."""
    turned = any(name in new for name in ORIENTATIONS)
    found = {name: text for name, text in old.items() if not (turned and name in ORIENTATIONS)}
    for name, text in new.items():
        tail = found[name].split()[len(text.split()) :] if name in found else []
        found[name] = " ".join([text, *tail]) if name in IN_PARTS and tail else text
    return found


def defaults_of(root: Element) -> Defaults:
    """The classes of all `<default>` sections; a nested class begins with its parent's."""
    classes: dict[str, dict[str, dict[str, str]]] = {"main": {}}

    def read(section: Element, name: str) -> None:
        for child in section:
            if child.tag != "default":
                tag = "actuator" if child.tag in ACTUATORS else child.tag
                classes[name][tag] = merged(classes[name].get(tag, {}), child.attributes)
        for child in section.all("default"):  # they begin with all that the outer class says
            inner = child.text("class")
            if inner in classes:
                raise InputError(f"{child.where}: there are two classes {inner!r}")
            classes[inner] = dict(classes[name])
            read(child, inner)

    for section in root.all("default"):
        top = section.attributes.get("class", "main")
        if top != "main":
            raise InputError(f"{section.where}: the outermost class is called main, not {top!r}")
        read(section, "main")
    return Defaults(classes)


@dataclass(frozen=True, eq=False)
class Reading:
    """What every element of a file is read with."""

    settings: Settings
    defaults: Defaults
    meshes: Mapping[str, Element]
    folder: Path | None
    unread: Unread
