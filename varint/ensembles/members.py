"""From arrays with or without a leading axis to the starts of all members, or a clear refusal."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from varint.discrete.constraints import every_row_function, position_rows_function
from varint.discrete.inertia import lacks_inertia
from varint.ensembles.asked import Asked
from varint.ensembles.broadcast import (
    broadcast_controls,
    broadcast_parameters,
    broadcast_rows,
    broadcast_tables,
    name_members,
    shaped_parameter,
)
from varint.errors import InputError
from varint.integration.problem import RunOptions, Start, initial_value_problem, time_grid
from varint.integration.start import start_function
from varint.numerics.arrays import over_columns
from varint.numerics.limits import check_memory, check_steps
from varint.rules.rule import Rule
from varint.scene.inputs import number
from varint.scene.system import System, parameters_by_name

CLEAR = 1e-12  # of what adds up to it: a constraint this small is held without doubt


@dataclass(frozen=True, eq=False)
class Members:
    """What `run` needs of every member; arrays have members first, or one row for all.

    `first` is the number of the first member in the whole ensemble; `v0` is None where momenta were
    given. Where steps are chosen, `asked` says how, and `steps` are the rows of controls, each for
    a time h.
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
    asked: Asked | None = None

    def __len__(self) -> int:
        return len(self.q0)

    def __getitem__(self, part: slice) -> Members:
        """The members of a slice."""
        numbers = range(len(self))[part]
        return replace(self.picked(np.arange(len(self))[part]), first=self.first + numbers.start)

    def picked(self, numbers: np.ndarray) -> Members:
        """The members of these numbers."""
        rows = {name: getattr(self, name) for name in ("q0", "v0", "p0", "u", "c")}
        rows = {
            name: x if x is None or len(x) == 1 < len(self) else x[numbers]
            for name, x in rows.items()
        }
        if len(rows["c"]) == 1 < len(numbers):
            rows["c"] = np.broadcast_to(rows["c"], (len(numbers), rows["c"].shape[1]))
        return replace(self, **rows)

    def of(self, name: str, i: int) -> Any:
        """Value of one member; None where it was not given."""
        rows = getattr(self, name)
        return None if rows is None else rows[i if len(rows) > 1 else 0]

    @property
    def k(self) -> np.ndarray:
        """Whole steps before each saved node; the nodes' numbers where steps are chosen."""
        if self.asked is not None:
            return np.arange(len(self.asked.times))
        k = np.arange(0, self.steps + 1, self.save_every)
        return k if k[-1] == self.steps else np.append(k, self.steps)

    @property
    def t(self) -> np.ndarray:
        """Times of the nodes."""
        return self.t0 + self.h * self.k if self.asked is None else self.asked.times


def members_of(
    system: System, rule: Rule, start: Start, options: RunOptions, asked: Asked | None
) -> Members:
    """Checked and broadcast input of all members."""
    n = system.structure.n
    q0, v0, p0, t0, params, u = start
    tables = None if u is None or asked is None else broadcast_tables(system, u)
    if asked is not None:
        count = 1 if tables is None else tables.shape[1]
        options = RunOptions(steps=count, duration=asked.duration)
    step, count = time_grid(options.h, options.steps, options.duration)
    check_steps(number("t0", t0), step, count)
    rows: dict[str, Any] = {
        name: None if x is None else broadcast_rows(name, x, (n,), system.names)
        for name, x in (("q0", q0), ("v0", v0), ("p0", p0))
    }
    values = broadcast_parameters(system, params)
    rows["u"] = tables
    if u is not None and tables is None:
        rows["u"] = broadcast_controls(system, rule, u, count)
    counts = {
        name: len(x) for name, x in {**rows, **values}.items() if x is not None and len(x) > 1
    }
    if not counts and not any(
        x is not None and x.shape[0] == 1 and np.ndim(y) > 1 for x, y in ((rows["q0"], q0),)
    ):
        raise InputError(
            "no argument has a leading axis of members; give for example q0 with shape (members, "
            "n) or a parameter with one value a member, or call simulate for a single motion"
        )
    total = max(counts.values(), default=1)
    if len(set(counts.values())) > 1:
        raise InputError(
            f"the numbers of members differ: {counts}; give each argument {total} rows, or one for "
            "all"
        )
    if tables is not None and np.ndim(u) < 3 and len(tables[0]) == total > 1:
        k = system.structure.controls
        raise InputError(
            f"u with shape {np.shape(u)} may be one table of {total} rows for all or one row for "
            f"each of {total} members; give it as (1, {total}, {k}) or as ({total}, 1, {k})"
        )
    c = np.concatenate(
        [
            np.empty((total, 0)),
            *(np.broadcast_to(x.reshape(len(x), -1), (total, x[0].size)) for x in values.values()),
        ],
        axis=1,
    )
    for name in ("q0", "v0", "p0"):
        if rows[name] is not None:
            rows[name] = np.ascontiguousarray(np.broadcast_to(rows[name], (total, n)))
    members = Members(
        0,
        rows["q0"],
        rows["v0"],
        rows["p0"],
        number("t0", t0),
        step,
        count,
        options.save_every,
        rows["u"],
        c,
        asked,
    )
    if is_plain(system) and (v0 is None) != (p0 is None):
        momenta(system, members)
    # one ordinary task checks everything that is the same for all members
    first = Start(
        q0=rows["q0"][0],
        v0=None if v0 is None else rows["v0"][0],
        p0=None if p0 is None else rows["p0"][0],
        t0=t0,
        params={name: shaped_parameter(system, name, x[0]) for name, x in values.items()},
        u=None if u is None else rows["u"][0],
    )
    with warnings.catch_warnings():
        if asked is not None:  # said with the members' runs
            warnings.simplefilter("ignore", UserWarning)
        problem = initial_value_problem(system, rule, first, options)
    kept = count // problem.save_every
    check_memory(f"an ensemble of {count} steps", kept, "keep fewer of them: save_every=…")
    members = replace(members, save_every=problem.save_every)
    _refuse_bad_starts(system, rule, members)
    return members


def _refuse_bad_starts(system: System, rule: Rule, members: Members) -> None:
    """Refuse starts off the constraints or inside contacts before any member moves: those in
    doubt are checked.
    """
    s, count = system.structure, len(members)
    m, k = s.constraints, s.nonholonomic
    if not (m or k or s.contacts):
        return
    v = np.zeros((count, s.n)) if members.v0 is None else members.v0
    t = np.full((count, 1), members.t0)
    options = options_of(members)
    held, _ = over_columns(position_rows_function(system), members.q0, t, members.c)
    rates, flat = over_columns(every_row_function(system), members.q0, v, t, members.c)
    slopes = np.abs(flat.reshape(count, s.n, -1))
    far, fast = (np.einsum("cir,ci->cr", slopes, np.abs(x)) for x in (members.q0, v))
    good = (np.abs(held[:, :m]) <= CLEAR * far[:, :m]).all(axis=1) & (held[:, m:] >= 0).all(axis=1)
    if members.p0 is None:
        good &= (np.abs(rates[:, : m + k]) <= CLEAR * fast[:, : m + k]).all(axis=1)
    for i in np.flatnonzero(~good).tolist():
        try:
            # of redundant rows: said when the first member was checked
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                initial_value_problem(system, rule, start_of(system, members, i), options)
        except InputError as error:
            raise InputError(f"member {i}: {error}") from None


def is_plain(system: System) -> bool:
    """Whether the members of the scene can be stepped together: their starts need nothing of
    their own.
    """
    s = system.structure
    return not (s.constraints or s.nonholonomic or s.contacts or s.degenerate)


def momenta(system: System, members: Members) -> np.ndarray:
    """Start momenta of plain scenes, (members, n), and a check of every member's start."""
    s, n, count = system.structure, system.structure.n, len(members)
    v = np.zeros((count, n)) if members.v0 is None else members.v0
    t = np.full((count, 1), members.t0)
    (values,) = over_columns(
        start_function(system), members.q0, v, np.zeros((count, s.controls)), t, members.c
    )
    p, mass = values[:, :n].copy(), values[:, 2 * n + 1 :]
    bad = ~(np.isfinite(values[:, : 2 * n]).all(axis=1) & np.isfinite(mass).all(axis=1))
    if bad.any():
        raise InputError(
            "the Lagrangian's derivatives are not finite at the start of "
            f"{name_members(bad, members.first)}: a collision, a square root or logarithm of a "
            "negative number, or a parameter value; change these starts or leave them out"
        )
    weak = lacks_inertia(mass.reshape(count, n, n))
    if weak.any():
        raise InputError(
            "the mass matrix ∂²L/∂v² is singular at the start of "
            f"{name_members(weak, members.first)}; use other coordinates or other starts"
        )
    return p if members.p0 is None else members.p0


def start_of(system: System, members: Members, i: int) -> Start:
    """The start of one member, as for `simulate`."""
    return Start(
        q0=members.of("q0", i),
        v0=members.of("v0", i),
        p0=members.of("p0", i),
        t0=members.t0,
        params=parameters_by_name(system, members.of("c", i)),
        u=members.of("u", i),
    )


def options_of(members: Members) -> RunOptions:
    """The grid that all members share."""
    return RunOptions(h=members.h, steps=members.steps, save_every=members.save_every)
