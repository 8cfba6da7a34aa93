"""Dataclasses whose methods are closures: Python's own write and compile source for every class,
half a millisecond that each process pays anew for each class that it imports.

`dataclasses.field`, `fields`, `replace` and `is_dataclass` work with both alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from inspect import Parameter, Signature, get_annotations
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
    from dataclasses import replace as replace
else:

    def dataclass(kind=None, /, *, frozen=False, eq=True, repr=True):
        """As `dataclasses.dataclass`, which says what these options mean; other options, `InitVar`,
        `ClassVar` and keyword-only fields are left to that.
        """

        def made(kind):
            return _with_methods(kind, _with_fields(kind), frozen, eq, repr)

        return made if kind is None else made(kind)

    def replace(record, /, **changes):
        """As `dataclasses.replace`, in half the time."""
        kind = type(record)
        for name in kind.__match_args__:
            if name not in changes:
                changes[name] = getattr(record, name)
        return kind(**changes)


MISSING = dataclasses.MISSING


def _with_fields(kind: Any) -> dict[str, Any]:
    """The fields of a class and its bases; defaults stay behind as attributes of the class."""
    fields: dict[str, Any] = {}
    for base in kind.__mro__[-1:0:-1]:
        fields |= base.__dict__.get("__dataclass_fields__", {})
    for name, annotation in get_annotations(kind).items():
        field = kind.__dict__.get(name, MISSING)
        if not isinstance(field, dataclasses.Field):
            field = dataclasses.field(default=field)
        elif field.default is MISSING:
            delattr(kind, name)
        else:
            setattr(kind, name, field.default)
        if field.default.__class__.__hash__ is None:
            raise ValueError(f"{kind.__name__}.{name}: instances would share a mutable default")
        field.name, field.type = name, annotation
        field._field_type = dataclasses._FIELD  # type: ignore[attr-defined]
        fields[name] = field
    kind.__dataclass_fields__ = fields
    return fields


def _with_methods(kind: Any, fields: dict[str, Any], frozen: bool, eq: bool, repr: bool) -> Any:
    """The class with what it does not define itself."""
    own = kind.__dict__
    methods: dict[str, Any] = {
        "__replace__": replace,
        "__match_args__": tuple(name for name, x in fields.items() if x.init),
    }
    if "__init__" not in own:
        kind.__signature__ = _SignatureWhenAsked()
        methods["__init__"] = _initialiser(kind, fields)
    if repr:
        methods["__repr__"] = _representation([name for name, x in fields.items() if x.repr])
    if frozen:
        methods |= {"__setattr__": _refuse_to_set, "__delattr__": _refuse_to_delete}
    if eq:
        compared = tuple(name for name, x in fields.items() if x.compare)
        # Python gives a class that defines __eq__ alone no hash
        if "__hash__" not in own or (own["__hash__"] is None and "__eq__" in own):
            kind.__hash__ = _hash_of(compared) if frozen else None
        methods["__eq__"] = _equality_of(compared)
    for name, method in methods.items():
        if name not in own:
            setattr(kind, name, method)
    return kind


def _initialiser(kind: Any, fields: dict[str, Any]) -> Callable[..., None]:
    names = [name for name, x in fields.items() if x.init]
    factories = {
        name: x.default_factory for name, x in fields.items() if x.default_factory is not MISSING
    }
    defaults = {name: fields[name].default for name in names}
    defaults = {name: default for name, default in defaults.items() if default is not MISSING}
    every, prepared = {*names, *factories}, hasattr(kind, "__post_init__")

    def __init__(self: Any, /, *args: Any, **given: Any) -> None:
        if args or given.keys() != every:
            state = defaults | dict(zip(names, args, strict=False)) | given
            for name in factories.keys() - state.keys():
                state[name] = factories[name]()
            twice = not given.keys().isdisjoint(names[: len(args)])
            if twice or len(args) > len(names) or state.keys() != every:
                _signature(kind).bind(*args, **given)  # says what is wrong
            given = state
        self.__dict__.update(given)
        if prepared:
            self.__post_init__()

    return __init__


def _signature(kind: Any) -> Signature:
    """What a class is called with."""

    def default(x: Any) -> Any:
        given = x.default if x.default_factory is MISSING else x.default_factory
        return Parameter.empty if given is MISSING else given

    return Signature(
        [
            Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=default(x), annotation=x.type)
            for name, x in kind.__dataclass_fields__.items()
            if x.init
        ],
        return_annotation=None,
    )


class _SignatureWhenAsked:
    """`__signature__` of a class, for `inspect.signature` and `help`."""

    def __get__(self, instance: Any, kind: Any) -> Signature:
        if instance is not None or "__signature__" not in kind.__dict__:
            raise AttributeError("__signature__")
        return _signature(kind)


def _representation(names: list[str]) -> Callable[[Any], str]:
    @recursive_repr()
    def __repr__(self: Any) -> str:
        inside = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__qualname__}({inside})"

    return __repr__


def _equality_of(names: tuple[str, ...]) -> Callable[[Any, Any], Any]:
    def __eq__(self: Any, other: Any) -> Any:
        if type(self) is not type(other):
            return NotImplemented
        return tuple(getattr(self, x) for x in names) == tuple(getattr(other, x) for x in names)

    return __eq__


def _hash_of(names: tuple[str, ...]) -> Callable[[Any], int]:
    def __hash__(self: Any) -> int:
        return hash(tuple(getattr(self, name) for name in names))

    return __hash__


def _refuse_to_set(self: Any, name: str, value: Any) -> None:
    _refuse(self, "assign to", name)
    object.__setattr__(self, name, value)


def _refuse_to_delete(self: Any, name: str) -> None:
    _refuse(self, "delete", name)
    object.__delattr__(self, name)


def _refuse(self: Any, what: str, name: str) -> None:
    """Frozen are all attributes of a dataclass, and the fields of what is derived from it."""
    if "__dataclass_fields__" in type(self).__dict__ or name in self.__dataclass_fields__:
        raise dataclasses.FrozenInstanceError(f"cannot {what} field {name!r}")
