"""From arrays with or without a leading axis to the starts of all members, or a clear refusal."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.arrays import over_columns
from varint.errors import InputError, converted
from varint.grid import affordable, checked_steps
from varint.manifold import every_row_function
from varint.rules import Rule
from varint.stepping.initial import held_function, initial_task, number, start_function, time_grid
from varint.system import System, parameter_values

CLEAR = 1e-12  # of what adds up to it: a constraint this small is held without doubt
SINGULAR = 1e-13  # smallest eigenvalue of the mass matrix scaled to a unit diagonal
MOST_NAMED = 5  # members named in a message


@dataclass(frozen=True, eq=False)
class Members:
    """What `run` needs of every member; arrays have members first, or one row for all.

    `first` is the number of the first member in the whole ensemble; `v0` is None where momenta were given.
    """

    first: int
    q0: np.ndarray
    v0: np.ndarray | None
    p0: np.ndarray | None
    t0: float
    h: float
    steps: int
    save_every: int
    u: np.ndarray | None
    c: np.ndarray

    def __len__(self) -> int:
        return len(self.q0)

    def __getitem__(self, part: slice) -> Members:
        """The members of a slice."""
        numbers = range(len(self))[part]
        return replace(self.picked(np.arange(len(self))[part]), first=self.first + numbers.start)

    def picked(self, numbers: np.ndarray) -> Members:
        """The members of these numbers."""
        rows = {name: getattr(self, name) for name in ("q0", "v0", "p0", "u", "c")}
        rows = {name: x if x is None or len(x) == 1 < len(self) else x[numbers] for name, x in rows.items()}
        if len(rows["c"]) == 1 < len(numbers):
            rows["c"] = np.broadcast_to(rows["c"], (len(numbers), rows["c"].shape[1]))
        return replace(self, **rows)

    def of(self, name: str, i: int) -> Any:
        """Value of one member; None where it was not given."""
        rows = getattr(self, name)
        return None if rows is None else rows[i if len(rows) > 1 else 0]

    @property
    def k(self) -> np.ndarray:
        """Whole steps before each saved node."""
        k = np.arange(0, self.steps + 1, self.save_every)
        return k if k[-1] == self.steps else np.append(k, self.steps)


def members_of(
    system: System, rule: Rule, *, q0: Any, v0: Any, p0: Any, h: Any, steps: Any, duration: Any, t0: Any, u: Any,
    params: Mapping[str, Any] | None, save_every: Any,
) -> Members:  # fmt: skip
    """Checked and broadcast input of all members."""
    n = system.structure.n
    step, count = time_grid(h, steps, duration)
    checked_steps(number("t0", t0), step, count)
    rows: dict[str, Any] = {
        name: None if x is None else _rows(name, x, (n,), system.names)
        for name, x in (("q0", q0), ("v0", v0), ("p0", p0))
    }
    values = _parameters(system, params)
    rows["u"] = None if u is None else _controls(system, rule, u, count)
    counts = {name: len(x) for name, x in {**rows, **values}.items() if x is not None and len(x) > 1}
    if not counts and not any(x is not None and x.shape[0] == 1 and np.ndim(y) > 1 for x, y in ((rows["q0"], q0),)):
        raise InputError(
            "no argument has a leading axis of members; give for example q0 with shape (members, n) or a parameter "
            "with one value a member, or call simulate for a single motion"
        )
    total = max(counts.values(), default=1)
    if len(set(counts.values())) > 1:
        raise InputError(f"the numbers of members differ: {counts}; give each argument {total} rows, or one for all")
    c = np.concatenate(
        [np.empty((total, 0)), *(np.broadcast_to(x.reshape(len(x), -1), (total, x[0].size)) for x in values.values())],
        axis=1,
    )
    for name in ("q0", "v0", "p0"):
        if rows[name] is not None:
            rows[name] = np.ascontiguousarray(np.broadcast_to(rows[name], (total, n)))
    members = Members(0, rows["q0"], rows["v0"], rows["p0"], number("t0", t0), step, count, save_every, rows["u"], c)
    if is_plain(system) and (v0 is None) != (p0 is None):
        momenta(system, members)
    # one ordinary task checks everything that is the same for all members
    task = initial_task(
        system, rule, q0=rows["q0"][0], v0=None if v0 is None else rows["v0"][0],
        p0=None if p0 is None else rows["p0"][0], h=h, steps=steps, duration=duration, t0=t0,
        u=None if u is None else rows["u"][0], params={name: _shaped(system, name, x[0]) for name, x in values.items()},
        save_every=save_every,
    )  # fmt: skip
    kept = count // task.save_every
    affordable(f"an ensemble of {count} steps", kept, "keep fewer of them: save_every=…")
    members = replace(members, save_every=task.save_every)
    _refuse_bad_starts(system, rule, members)
    return members


def _refuse_bad_starts(system: System, rule: Rule, members: Members) -> None:
    """Refuse starts off the constraints or inside contacts before any member moves: those in doubt are checked."""
    s, count = system.structure, len(members)
    m, k = s.constraints, s.nonholonomic
    if not (m or k or s.contacts):
        return
    v = np.zeros((count, s.n)) if members.v0 is None else members.v0
    t = np.full((count, 1), members.t0)
    (held,) = over_columns(held_function(system), members.q0, t, members.c)
    rates, flat = over_columns(every_row_function(system), members.q0, v, t, members.c)
    slopes = np.abs(flat.reshape(count, s.n, -1))
    far, fast = (np.einsum("cir,ci->cr", slopes, np.abs(x)) for x in (members.q0, v))
    good = (np.abs(held[:, :m]) <= CLEAR * far[:, :m]).all(axis=1) & (held[:, m:] >= 0).all(axis=1)
    if members.p0 is None:
        good &= (np.abs(rates[:, : m + k]) <= CLEAR * fast[:, : m + k]).all(axis=1)
    for i in np.flatnonzero(~good).tolist():
        try:
            with warnings.catch_warnings():  # of redundant rows: said when the first member was checked
                warnings.simplefilter("ignore", UserWarning)
                initial_task(system, rule, **arguments_of(system, members, i))
        except InputError as error:
            raise InputError(f"member {i}: {error}") from None


def is_plain(system: System) -> bool:
    """Whether the members of the scene can be stepped together: their starts need nothing of their own."""
    s = system.structure
    return not (s.constraints or s.nonholonomic or s.contacts or s.degenerate)


def momenta(system: System, members: Members) -> np.ndarray:
    """Start momenta of plain scenes, (members, n), and a check of every member's start."""
    s, n, count = system.structure, system.structure.n, len(members)
    v = np.zeros((count, n)) if members.v0 is None else members.v0
    t = np.full((count, 1), members.t0)
    p, mass, push, _ = over_columns(start_function(system), members.q0, v, np.zeros((count, s.controls)), t, members.c)
    bad = ~(np.isfinite(p).all(axis=1) & np.isfinite(mass).all(axis=1) & np.isfinite(push).all(axis=1))
    if bad.any():
        raise InputError(
            f"the Lagrangian's derivatives are not finite at the start of {_named(bad, members.first)}: a collision, a "
            "square root or logarithm of a negative number, or a parameter value; change these starts or leave them out"
        )
    matrices = mass.reshape(count, n, n)
    size = np.sqrt(np.abs(np.einsum("mii->mi", matrices)))
    size = np.where(size > 0, size, 1)
    weak = np.abs(np.linalg.eigvalsh(matrices / size[:, :, None] / size[:, None, :])).min(axis=1) <= SINGULAR
    if weak.any():
        raise InputError(
            f"the mass matrix ∂²L/∂v² is singular at the start of {_named(weak, members.first)}; use other coordinates "
            "or other starts"
        )
    return p if members.p0 is None else members.p0


def arguments_of(system: System, members: Members, i: int) -> dict[str, Any]:
    """What to call `simulate` with for one member."""
    c, first, params = members.of("c", i), 0, {}
    for name, default in system.defaults.items():
        params[name] = c[first : first + default.size].reshape(default.shape, order="F")
        first += default.size
    return dict(
        q0=members.of("q0", i), v0=members.of("v0", i), p0=members.of("p0", i), h=members.h, steps=members.steps,
        duration=None, t0=members.t0, u=members.of("u", i), params=params, save_every=members.save_every,
    )  # fmt: skip


def _rows(what: str, x: Any, shape: tuple[int, ...], names: Any) -> np.ndarray:
    """x as rows of `shape`: one for all, or one a member."""
    value = converted(
        lambda: np.array(x, dtype=float),
        lambda: f"{what} must be numbers of shape {shape} or (members, …), got {type(x).__name__}",
    )
    if shape == (1,) and value.ndim <= 1:
        value = value.reshape(-1, 1)  # one coordinate: a list of numbers is a list of members
    if value.shape == shape:
        value = value[None]
    if value.ndim != len(shape) + 1 or value.shape[1:] != shape or not len(value):
        raise InputError(
            f"{what} has shape {value.shape}; it must be {shape}, or {('members', *shape)} with one row a member"
            + (f" ({', '.join(names)})" if names else "")
        )
    bad = ~np.isfinite(value.reshape(len(value), -1)).all(axis=1)
    if bad.any():
        raise InputError(f"{what} is not finite in {_named(bad, 0)}")
    return value


def _parameters(system: System, params: Mapping[str, Any] | None) -> dict[str, np.ndarray]:
    """Rows (1 or members, size) of every parameter, in the order of `system.c`."""
    if params is not None and not isinstance(params, Mapping):
        raise InputError(f"params must be a dictionary of names and values, got {type(params).__name__}")
    parameter_values(system, {name: 0 for name in params or {} if name not in system.defaults})  # refuses the unknown
    found = {}
    for name, default in system.defaults.items():
        rows = _rows(f"params[{name!r}]", (params or {}).get(name, default), default.shape, None)
        found[name] = rows.transpose(0, *reversed(range(1, rows.ndim))).reshape(len(rows), -1)  # column by column
    return found


def _shaped(system: System, name: str, x: np.ndarray) -> np.ndarray:
    return x.reshape(system.defaults[name].shape, order="F")


def _controls(system: System, rule: Rule, u: Any, steps: int) -> np.ndarray:
    """Controls (1 or members, steps, k) or (…, steps, r, k): a leading axis only before a whole table."""
    k, r = system.structure.controls, len(rule.nodes)
    value = converted(lambda: np.array(u, dtype=float), lambda: f"u must be numbers, got {type(u).__name__}")
    tables = [(steps, k), (steps, r, k)]
    shared, each = value.shape in [*tables, (k,), ()] or value.ndim < 2, value.ndim > 2 and value.shape[1:] in tables
    if shared and each:
        raise InputError(
            f"u with shape {value.shape} may be one table ({steps}, {r}, {k}) for all or ({steps}, {k}) for each of "
            f"{len(value)} members; give it as (members, {steps}, {r}, {k})"
        )
    if each and not np.isfinite(value).all():
        raise InputError("u is not finite everywhere")
    return value if each else value[None]


def _named(bad: np.ndarray, first: int) -> str:
    numbers = np.flatnonzero(bad) + first
    more = f", … ({len(numbers)} in all)" if len(numbers) > MOST_NAMED else ""
    return f"members {numbers[:MOST_NAMED].tolist()}{more}"
