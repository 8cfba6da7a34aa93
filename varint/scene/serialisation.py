"""Systems, rules and expressions as text: for files, for other processes, and to tell one run from
another.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.files import VERSION
from varint.numerics.plain import field_of, plain, record_of
from varint.rules.rule import Rule
from varint.scene.description import (
    FUNCTION,
    describe_expressions,
    description,
    parts_of,
    trusted_parts_of,
)
from varint.scene.expressions import in_own_symbols
from varint.scene.memory import per_system
from varint.scene.system import System

# of a rule in a file, whose matrices are computed with 50 digits; rules have at most 36 stages
MOST_NODES, LARGEST = 64, 1e6
UNTRUSTED = (
    "it was written by an older version, with its system as a serialised CasADi function, and to "
    "open such a file can run any program hidden in it; if you know who wrote it, read it by "
    "load(path, trust=True) and save it anew"
)


@per_system
def describe(system: System) -> dict[str, Any]:
    """The system as plain data: names, parameters, restitution, and its expressions as elementary
    operations.
    """
    return description(system)


def revive(data: Any, *, trust: bool = False) -> System:
    """The system that `describe` wrote down, with symbols of the same names.

    Raises
    ------
    InputError
        If the data describe no system; or hold a serialised CasADi function, as files of format 1
        do, and are not to be trusted.
    """
    if not (isinstance(data, dict) and FUNCTION in data):
        return System(**parts_of(data))
    if not trust:
        raise InputError(UNTRUSTED)
    system = System(**trusted_parts_of(data))
    describe(system)  # refuses what is no arithmetic
    return system


def rule_of(data: Any) -> Rule:
    """The rule of ``plain(rule)``, also after a way through JSON.

    Raises
    ------
    InputError
        If the data are no rule.
    """
    for name in ("nodes", "weights", "points", "kicks", "drifts"):
        numbers = field_of(data, name, list[float])
        if len(numbers) > MOST_NODES or not all(abs(x) <= LARGEST for x in numbers):
            raise InputError(
                f"the {name} of the rule are not at most {MOST_NODES} numbers of size 1"
            )
    return record_of(Rule, "the rule", data)


def expression_as_data(system: System, expression: Any, what: str) -> str:
    """An expression of the system's symbols as text: equal texts, equal values to the bit."""
    own = in_own_symbols(expression, system, what)
    return json.dumps(plain(describe_expressions(system, {"": own})))


def identity(system: System, rule: Rule | None, **numbers: Any) -> dict[str, str]:
    """What makes a run this run, by name: two runs with equal identities give equal bytes.

    Versions of varint and CasADi belong to it: another version may round differently.
    """
    text = json.dumps([describe(system), plain(rule)], sort_keys=True)
    short = {"system and rule": text.encode()}
    for name, x in numbers.items():
        short[name] = x.encode() if isinstance(x, str) else _bytes(np.asarray(x, dtype=float))
    return {"varint": VERSION, "casadi": ca.__version__} | {
        name: hashlib.sha256(data).hexdigest() for name, data in short.items()
    }


def _bytes(x: np.ndarray) -> bytes:
    return str(x.shape).encode() + np.ascontiguousarray(x).tobytes()


def differences(one: dict[str, str], other: dict[str, str]) -> list[str]:
    """Names of the parts in which two identities differ."""
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
