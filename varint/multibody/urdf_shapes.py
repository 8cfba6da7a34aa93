"""Shapes and meshes of URDF: what is drawn of a link, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from varint.errors import InputError
from varint.multibody.data import Placement
from varint.multibody.elements import Element, Unread, file_within
from varint.multibody.mesh import Mesh, can_read
from varint.multibody.rotations import roll_pitch_yaw
from varint.multibody.shapes import GREY, Shape

NONE = (0.0, 0.0, 0.0)


def origin(element: Element) -> Placement:
    """The `<origin xyz rpy>` of an element."""
    place = element.one("origin")
    if place is None:
        return Placement(np.zeros(3), np.eye(3))
    angles = place.numbers("rpy", 3, NONE)
    return Placement(place.numbers("xyz", 3, NONE), roll_pitch_yaw(*angles))


def link_shapes(
    link: Element, materials: dict[str, Element], folder: Path | None, unread: Unread
) -> tuple[Shape, ...]:
    """What is drawn of a link: its `<visual>`s, or its `<collision>`s where those are files that
    cannot be read here.
    """
    shapes = _shapes_of(link.all("visual"), materials, folder, unread)
    if all(shape.mesh is None or can_read(shape.mesh) for shape in shapes):
        return shapes
    return _shapes_of(link.all("collision"), materials, folder, unread)


def _shapes_of(
    visuals: Sequence[Element], materials: dict[str, Element], folder: Path | None, unread: Unread
) -> tuple[Shape, ...]:
    found = []
    for visual in visuals:
        geometry = visual.one("geometry")
        if geometry is None:
            raise InputError(f"{visual.where} needs a <geometry>")
        shape = _shape(geometry, origin(visual), _colour(visual, materials), folder, unread)
        found += [shape] if shape is not None else []
    return tuple(found)


def _colour(visual: Element, materials: dict[str, Element]) -> tuple[float, ...]:
    material = visual.one("material")
    colour = None if material is None else material.one("color")
    if material is not None and colour is None:
        known = materials.get(material.attributes.get("name", ""))
        colour = None if known is None else known.one("color")
    return GREY if colour is None else tuple(map(float, colour.numbers("rgba", 4, GREY)))


def _shape(
    geometry: Element,
    place: Placement,
    colour: tuple[float, ...],
    folder: Path | None,
    unread: Unread,
) -> Shape | None:
    unread.only(geometry, ("box", "cylinder", "sphere", "capsule", "mesh"), ())
    for form in geometry:
        if form.tag == "box":
            size = tuple(map(float, form.numbers("size", 3, (1.0, 1.0, 1.0)) / 2))
            return Shape("box", size, place, colour)
        if form.tag in ("cylinder", "capsule"):
            size = (form.number("radius"), form.number("length") / 2)
            return Shape(form.tag, size, place, colour)
        if form.tag == "sphere":
            return Shape("sphere", (form.number("radius"),), place, colour)
        if form.tag == "mesh":
            x, y, z = form.numbers("scale", 3, (1.0, 1.0, 1.0))
            path = mesh_file(form, folder, unread)
            if path is None:
                return None
            mesh = Mesh(path, (float(x), float(y), float(z)))
            return Shape("mesh", (), place, colour, mesh)
    return None


def mesh_file(element: Element, folder: Path | None, unread: Unread) -> Path | None:
    """The file of a mesh within the folder; a drawing does without one that is not there."""
    name = element.text("filename")
    if name.startswith("package://"):
        package, _, rest = name[len("package://") :].partition("/")
        # the package's folder beneath ours, or ours itself
        inside = folder is not None and (folder / package).is_dir()
        name = f"{package}/{rest}" if inside else rest
    try:
        return file_within(folder, name, element)
    except InputError:
        unread.note(element, "", "not found in the folder, or outside it: not drawn")
        return None
