"""A system as plain data: names, numbers, and its expressions as elementary operations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.numerics.operations import Operations, Output, expressions_of, operations_of
from varint.numerics.plain import plain, reader_of, record_of
from varint.scene.kinetics import Kinetics
from varint.scene.parameters import Parameters

EXPRESSIONS = ("lagrangian", "force", "constraint", "nonholonomic", "contact")
SYMBOLS = ("q", "v", "t", "control")
KINETICS = ("mass_matrix", "velocity", "stiffness", "damping", "slopes")  # of scenes that have them
FUNCTION = "functions"  # where files of format 1 have a serialised CasADi function


class ParameterRecord(NamedTuple):
    """A parameter's name, the shape of its default, and its numbers row by row."""

    name: str
    shape: list[int]
    values: list[float]


class SystemRecord(NamedTuple):
    """A system as a file holds it; numbers within operations are written in hexadecimal, so that
    they come back to the bit, infinities included.
    """

    symbols: dict[str, list[str]]
    parameters: list[ParameterRecord]
    restitution: list[float]
    operations: list  # each a list, a name and what it takes
    expressions: dict[str, Output]
    rays: list[list[int]] = []  # noqa: RUF012 - the default of a tuple's field, never changed


def describe_expressions(
    system: Any, expressions: Mapping[str, ca.SX]
) -> tuple[list[list[Any]], dict[str, Output]]:
    """Operations and outputs of expressions of q, v, t, the controls and the parameters."""
    s = system
    inputs = [s.q, s.v, s.t, s.control, s.c]
    if s.kinetics is not None:
        inputs.append(s.kinetics.momentum)
    found = operations_of(ca.Function("system", inputs, list(expressions.values())))
    nodes = [
        ["const", float(node[1]).hex()] if node[0] == "const" else list(node)
        for node in found.nodes
    ]
    return nodes, dict(zip(expressions, found.outputs, strict=True))


def description(system: Any) -> dict[str, Any]:
    """The system as plain data, exactly.

    Raises
    ------
    VarintError
        If an expression holds what is no elementary operation.
    """
    symbols = {name: getattr(system, name) for name in SYMBOLS}
    expressions = {name: getattr(system, name) for name in EXPRESSIONS}
    if not system.bounce.is_constant():
        expressions["restitution"] = system.bounce
    if (kinetics := system.kinetics) is not None:
        symbols["momentum"] = kinetics.momentum
        expressions |= {name: getattr(kinetics, name) for name in KINETICS}
    return plain(
        SystemRecord(
            {name: [x[i].name() for i in range(x.numel())] for name, x in symbols.items()},
            [
                ParameterRecord(name, list(value.shape), value.ravel().tolist())
                for name, value in system.defaults.items()
            ],
            system.restitution.tolist(),
            *describe_expressions(system, expressions),
            [list(group) for group in system.rays],
        )
    )


def parts_of(data: Any) -> dict[str, Any]:
    """The arguments of `System` that `description` wrote down, with symbols of the same names.

    Raises
    ------
    InputError
        If the data describe no system.
    """
    record = record_of(SystemRecord, "the system", data)
    symbols = {name: _symbols(name, record.symbols) for name in SYMBOLS}
    params = _parameters(record.parameters)
    inputs = [*symbols.values(), _vector(params)]
    missing = [name for name in EXPRESSIONS if name not in record.expressions]
    if missing:
        raise InputError(f"the system has no {', '.join(missing)}")
    optional = *KINETICS, "restitution"
    written = [name for name in (*EXPRESSIONS, *optional) if name in record.expressions]
    outputs = [record.expressions[name] for name in written]
    momentum = _symbols("momentum", {"momentum": [], **record.symbols})
    nodes = [_node(i, node) for i, node in enumerate(record.operations)]
    found = dict(
        zip(written, expressions_of(Operations(nodes, outputs), [*inputs, momentum]), strict=True)
    )
    known = {name: found.pop(name) for name in KINETICS if name in found}
    kinetics = None
    if {"mass_matrix", "velocity"} <= known.keys():
        kinetics = Kinetics(momentum=momentum, **known)
    return {
        **symbols,
        "restitution": record.restitution,
        **found,
        "params": params,
        "kinetics": kinetics,
        "rays": record.rays,
    }


def trusted_parts_of(data: Any) -> dict[str, Any]:
    """The same of what files of format 1 hold: CasADi rebuilds a function of any kind, compiled
    and external ones included, so that such a file may run anything.
    """
    try:
        names: list[list[str]] = data["names"]
        symbols = {
            name: _symbols(name, {name: list(words)})
            for name, words in zip((*SYMBOLS, ""), names, strict=True)
            if name
        }
        params = Parameters(**data["parameters"]) if data["parameters"] else None
        function = ca.Function.deserialize(data[FUNCTION])
        found = function(*symbols.values(), _vector(params))
        return {
            **symbols,
            **dict(zip(EXPRESSIONS, found, strict=True)),
            "restitution": data["restitution"],
            "params": params,
        }
    except (KeyError, TypeError, ValueError, RuntimeError, NotImplementedError) as error:
        raise InputError(
            f"this CasADi cannot read the saved system: {str(error).partition(chr(10))[0]}"
        ) from None


def _symbols(what: str, named: dict[str, list[str]]) -> ca.SX:
    names: Sequence[str] = reader_of(list[str])(what, named.get(what))
    return ca.vertcat(ca.SX(0, 1), *(ca.SX.sym(name) for name in names))


def _vector(params: Parameters | None) -> ca.SX:
    symbols = params._symbols.values() if params is not None else ()
    return ca.vertcat(ca.SX(0, 1), *(ca.vec(x) for x in symbols))


def _parameters(records: list[ParameterRecord]) -> Parameters | None:
    """The parameters with their defaults; None where there are none."""
    values = {}
    for name, shape, numbers in records:
        if min(shape, default=0) < 0 or math.prod(shape) != len(numbers) or name in values:
            raise InputError(
                f"the parameter {name!r} has {len(numbers)} numbers and the shape {shape}, or "
                "comes twice"
            )
        values[name] = np.array(numbers).reshape(shape)
    return Parameters(**values) if values else None


def _node(i: int, node: Any) -> tuple[Any, ...]:
    """An operation, its number read."""

    def read() -> tuple[Any, ...]:
        name, *rest = node
        if not (isinstance(node, list) and isinstance(name, str)):
            raise TypeError
        if name != "const":
            return name, *rest
        [text] = rest
        return name, float.fromhex(text)

    return parsed_or_refused(
        read, lambda: f"operation {i} is no name, number or input: {ascii(node)[:60]}"
    )
