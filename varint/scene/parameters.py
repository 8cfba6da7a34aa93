"""Named constants that stay symbolic, with the values that stand for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.scene.inputs import finite_array

# values of parameters by name or symbol; pairs, because CasADi hashes no vectors
ParameterValues = Mapping[Any, Any] | Sequence[tuple[Any, Any]]


class Parameters:
    """Named constants that stay symbolic, with default values.

    ``c = Parameters(length=1.0, g=9.81)`` gives the symbols ``c.length`` and ``c.g``; other values
    are set per run by ``params=dict(length=2.0)`` without building anything anew. Arrays make
    vectors and matrices of symbols.

    Parameters
    ----------
    **defaults : float or array
        Default value of each parameter (at most two dimensions).

    Examples
    --------
    >>> import varint as vi
    >>> c = vi.Parameters(length=1.0, g=9.81)
    >>> c.length * c.g
    SX((length*g))
    """

    def __init__(self, /, **defaults: Any):
        values = {}
        for name, default in defaults.items():
            value = finite_array(f"parameter {name!r}", default)
            if value.ndim > 2:
                raise InputError(
                    f"parameter {name!r} has shape {value.shape}; at most two dimensions are "
                    "possible"
                )
            values[name] = value
        self._defaults = values
        self._symbols = {
            name: ca.SX.sym(name, *_symbol_shape(value)) for name, value in values.items()
        }

    def __getattr__(self, name: str) -> ca.SX:
        symbols = self.__dict__.get("_symbols", {})  # not there yet while it is being copied
        if name in symbols:
            return symbols[name]
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(f"unknown parameters [{name!r}]; known: {list(symbols)}")

    def __contains__(self, name: str) -> bool:
        return name in self._defaults

    def __repr__(self) -> str:
        return f"Parameters({', '.join(f'{k}={v.tolist()}' for k, v in self._defaults.items())})"


def parameters_of(given: Parameters | ParameterValues) -> Parameters:
    """The parameters of a scene: `Parameters`, or the user's own symbols with default values."""
    if isinstance(given, Parameters):
        return given
    made = Parameters()
    for symbol, default in pairs(
        "params",
        given,
        "Parameters, or a dictionary from symbols to default values such as {m: 1.0}",
    ):
        if not isinstance(symbol, ca.SX):
            raise InputError(
                f"params of a System has the key {symbol!r}; give the symbol itself, "
                f"{{m: 1.0}} with m = ca.SX.sym('m'), or Parameters(m=1.0)"
            )
        name = _name_of(symbol)
        if name in made._symbols:
            raise InputError(f"params has two symbols of the name {name!r}; give each its own")
        rows, columns = symbol.shape
        shape = (rows, columns) if columns > 1 else (rows,) if rows > 1 else ()
        made._symbols[name] = symbol
        made._defaults[name] = parameter_array(name, default, shape, "symbol")
    return made


def parameter_vector(given: Parameters) -> ca.SX:
    """All parameters as one column vector of symbols."""
    return ca.vertcat(ca.SX(0, 1), *(ca.vec(x) for x in given._symbols.values()))


def with_more(given: Parameters, **defaults: Any) -> Parameters:
    """The same parameters, symbols included, and new ones."""
    added, joined = Parameters(**defaults), Parameters()
    joined._symbols |= given._symbols | added._symbols
    joined._defaults |= given._defaults | added._defaults
    return joined


def values_by_name(given: ParameterValues) -> dict[str, Any]:
    """Values of parameters by name, from a dictionary whose keys are names or symbols."""
    found: dict[str, Any] = {}
    for key, value in pairs("params", given, "a dictionary of names or symbols and values"):
        name = key if isinstance(key, str) else _name_of(key)
        if name in found:
            raise InputError(f"params has two values for {name!r}; give one")
        found[name] = value
    return found


def parameter_array(name: str, given: Any, shape: tuple[int, ...], whose: str) -> np.ndarray:
    """Finite numbers of the shape of the parameter; those of its symbol are as good."""
    if type(given) is float and shape == () and math.isfinite(given):
        return np.array(given)  # in half the time
    value = finite_array(f"parameter {name!r}", given)
    if value.shape != shape and value.shape != _symbol_shape(np.empty(shape)):
        raise InputError(f"parameter {name!r} has shape {value.shape}; its {whose} has {shape}")
    return value.reshape(shape)


def pairs(what: str, given: Any, wanted: str) -> list[tuple[Any, Any]]:
    """(key, value) of a dictionary, or the list of pairs itself."""
    if isinstance(given, Mapping):
        return list(given.items())
    is_list = isinstance(given, Sequence) and not isinstance(given, str)
    if not is_list or not all(isinstance(pair, tuple) and len(pair) == 2 for pair in given):
        raise InputError(
            f"{what} must be {wanted}, or a list of such pairs, got {type(given).__name__}"
        )
    return list(given)


def _name_of(symbol: Any) -> str:
    """The name that a symbol, or a vector or matrix of symbols, was made with."""
    if not isinstance(symbol, ca.SX) or not symbol.is_valid_input() or not symbol.is_dense():
        raise InputError(
            f"params has the key {symbol!r}; keys are names or symbols, ca.SX.sym(name) or "
            "ca.SX.sym(name, rows, columns)"
        )
    names = [element.name() for element in ca.vertsplit(ca.vec(symbol))] if symbol.numel() else []
    stem = names[0] if len(names) == 1 else "".join(names[:1]).removesuffix("_0")
    if not stem or (len(names) > 1 and names != [f"{stem}_{i}" for i in range(len(names))]):
        raise InputError(
            f"params has the key {symbol}, which is not one symbol with a name; make each by "
            "ca.SX.sym(name) or ca.SX.sym(name, rows, columns)"
        )
    return stem


def _symbol_shape(value: np.ndarray) -> tuple[int, int]:
    return (value.shape[0], value.shape[1] if value.ndim == 2 else 1) if value.ndim else (1, 1)
