"""A system as plain data: for files, for other processes, and to tell one run from another."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import VarintError
from varint.parameters import Parameters
from varint.rules import Rule
from varint.system import System, per_system


@per_system
def describe(system: System) -> dict[str, Any]:
    """The system as plain data: names, parameters, restitution and its expressions as a serialised function."""
    s = system
    inputs = [s.q, s.v, s.t, s.control, s.c]
    outputs = [s.lagrangian, s.force, s.constraint, s.nonholonomic, s.contact]
    return {
        "names": [[x.name() for x in ca.vertsplit(part)] if part.numel() else [] for part in inputs],
        "parameters": {name: value.tolist() for name, value in s.defaults.items()},
        "restitution": s.restitution.tolist(),
        "functions": ca.Function("system", inputs, outputs).serialize(),
    }


def revive(data: dict[str, Any]) -> System:
    """The system that `describe` wrote down, with symbols of the same names."""
    q, v, t, u, _ = (ca.vertcat(ca.SX(0, 1), *(ca.SX.sym(name) for name in names)) for names in data["names"])
    params = Parameters(**data["parameters"]) if data["parameters"] else None
    c = ca.vertcat(ca.SX(0, 1), *(ca.vec(x) for x in params._symbols.values())) if params else ca.SX(0, 1)
    try:
        function = ca.Function.deserialize(data["functions"])
    except RuntimeError as error:
        raise VarintError(f"this CasADi cannot read the saved system: {str(error).splitlines()[0]}") from None
    lagrangian, force, constraint, nonholonomic, contact = function(q, v, t, u, c)
    return System(
        q, v, lagrangian, constraint=constraint, nonholonomic=nonholonomic, contact=contact,
        restitution=data["restitution"], force=force, control=u, params=params, t=t,
    )  # fmt: skip


def rule_of(data: dict[str, Any]) -> Rule:
    """The rule of ``asdict(rule)``, also after a way through JSON."""
    fields: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in data.items()}
    return Rule(**fields)


def identity(system: System, rule: Rule, **numbers: Any) -> dict[str, str]:
    """What makes a run this run, by name: two runs with equal identities give equal bytes.

    Versions of varint and CasADi belong to it: another version may round differently.
    """
    from varint import __version__

    plain = json.dumps([describe(system), asdict(rule)], sort_keys=True)
    short = {"system and rule": plain.encode()}
    for name, x in numbers.items():
        short[name] = x.encode() if isinstance(x, str) else _bytes(np.asarray(x, dtype=float))
    return {"varint": __version__, "casadi": ca.__version__} | {
        name: hashlib.sha256(data).hexdigest() for name, data in short.items()
    }


def _bytes(x: np.ndarray) -> bytes:
    return str(x.shape).encode() + np.ascontiguousarray(x).tobytes()


def differences(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """Names of the parts in which two identities differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
