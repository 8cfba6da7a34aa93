"""Ensembles: one call for many motions."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from typing import Any

from varint.ensembles.asked import asked_of
from varint.ensembles.chosen import warn_of_said
from varint.ensembles.chunk import Chunk, Said
from varint.ensembles.energy_check import members_astray, warn_of
from varint.ensembles.executor import compute
from varint.ensembles.members import Members, members_of
from varint.ensembles.result import Ensemble
from varint.ensembles.store import load_store, open_store
from varint.errors import InputError
from varint.integration.cost import repays
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start
from varint.integration.steppers.linear import is_linear
from varint.numerics.progress import progress_bar
from varint.rules.rule import Rule
from varint.scene.parameters import ParameterValues
from varint.scene.system import System

BACKENDS = ("auto", "compiled", "interpreted")


def ensemble(
    system: System,
    rule: Rule | None = None,
    *,
    q0: Any,
    v0: Any = None,
    p0: Any = None,
    h: float | None = None,
    steps: int | None = None,
    duration: float | None = None,
    t0: float = 0.0,
    u: Any = None,
    params: ParameterValues | None = None,
    save_every: int = 1,
    at: Any = None,
    tol: float | None = None,
    executor: Executor | None = None,
    store: Any = None,
    progress: bool | None = None,
    backend: str = "auto",
) -> Ensemble:
    """Motions from many starts, parameters or controls: each is what `simulate` makes of it, to the
    bit where steps are chosen or interpreted.

    D2 L_d(q_{k−1}, q_k) + D1 L_d(q_k, q_{k+1}) = 0 for every member. Starts, parameters and
    controls may have a leading axis of members; what has none is the same for all.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own; where steps are chosen, each member's own, that of
        ``ensemble[i].rule``.
    q0, v0, p0 : array (n,) or (members, n)
        Starts; for one coordinate also (members,).
    h, steps, duration : float, int, float
        Step size, number of steps, total time: two of the three, the same for all members; or the
        duration alone, where each member has the rule and the steps that the accuracy `tol` asks
        for.
    t0 : float
        Start time.
    u : array, optional
        Controls as for `simulate`, or (members, steps, k), or (members, steps, r, k); where steps
        are chosen (members, rows, k), with one row for what is the same all the time.
    params : dict, optional
        Values of parameters by name or symbol, or one value a member along a leading axis.
    save_every : int
        Keep every so many steps. Where steps are chosen, `at` says what is kept.
    at : array (k,), optional
        Times that become the nodes of all members, whose steps are chosen. Later and later ones;
        members run until the last of them if no duration is given. Default: 101, from the start to
        the end.
    tol : float, optional
        Wanted error of every coordinate of every member, divided by the range of its motion, as
        for `simulate`. With `duration` or `at` alone it is 1e-9. `Ensemble.error_estimate` has what
        was reached; one warning names the members for which that is more.
    executor : concurrent.futures.Executor, optional
        Where chunks of members run: threads, processes,
        ``dask.distributed.Client().get_executor()``, an MPI pool. The system travels as data.
        Chunks of lost workers are done again. Where steps are chosen, threads take turns.
    store : path or zarr.Group, optional
        Folder in which finished chunks are kept, or a zarr group (a path that ends in .zarr is one;
        needs the extra ``zarr``). The result reads them one by one, so that it may be larger than
        memory; the same call after an interruption does what is missing.
    progress : bool, optional
        Show a progress bar. Default: in a terminal, for work longer than a second.
    backend : {"auto", "compiled", "interpreted"}
        Compiled, members fill the lanes of vectors: compositions of separable scenes with constant
        mass, and Gauss rules of regular scenes without constraints and contacts. By default so
        where the work is large enough to repay the compiler. Chunks do not show in either. With
        contacts, each member flies in the native core as `simulate` has it, whatever is asked;
        where steps are chosen, it is run by this backend of `simulate`.

    Returns
    -------
    Ensemble
        A member that fails does not take the others along: `Ensemble.errors` has its error, its
        arrays end there.

    Raises
    ------
    InputError
        If the input is not a well-posed problem; the message says which members are wrong, and how.
    VarintError
        If members are lost with their workers again and again.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import varint as vi
    >>> c = vi.Parameters(length=1.0, g=9.81)
    >>> q, v = vi.coordinates("theta")
    >>> pendulum = vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)
    >>> lengths = np.linspace(0.5, 2, 200)
    >>> sweep = vi.ensemble(pendulum, q0=0.05, v0=0.0, duration=1.0, params=dict(length=lengths))
    >>> sweep.q.shape, bool((sweep.error_estimate < 1e-9).all())
    ((200, 101, 1), True)
    >>> start = dict(q0=0.05, v0=0.0, h=0.01, steps=100)
    >>> sweep = vi.ensemble(pendulum, **start, params=dict(length=lengths))
    >>> sweep.q.shape, len(sweep.failed), float(sweep[7].parameters["length"] - lengths[7])
    ((200, 101, 1), 0, 0.0)
    """
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise InputError(
            "executor must have a submit method as concurrent.futures.Executor has, got "
            f"{type(executor).__name__}; of a dask Client take client.get_executor()"
        )
    if backend not in BACKENDS:
        raise InputError(f"unknown backend {backend!r}; known: {list(BACKENDS)}")
    asked = asked_of(h, steps, duration, t0, save_every, at, tol, backend)
    own = plan(system, rule).rule
    members = members_of(
        system,
        own,
        Start(q0, v0, p0, t0, params, u),
        RunOptions(h=h, steps=steps, duration=duration, save_every=save_every),
        asked,
    )
    rule, loop = (
        (own, _backend(system, own, members, backend)) if asked is None else (rule, backend)
    )
    kept = None if store is None else open_store(store, system, rule, members, loop)
    done = kept.ranges if kept is not None else []
    chunks: list[Chunk] = []
    before = sum(count for _, count in done)
    strays: list[tuple[int, float, float]] = []
    said: list[Said] = []
    with progress_bar(len(members), "member", progress, before) as move:
        for chunk in compute(system, rule, members, _missing(done, len(members)), executor, loop):
            said += chunk.said
            if asked is None:
                strays += members_astray(system, own, members, chunk)
            if kept is None:
                chunks.append(chunk)
            else:
                kept.add(chunk)
            move(len(chunk), partial(_note, chunk))
    warn_of(sorted(strays), members.h)
    warn_of_said(said)
    chunks.sort(key=lambda chunk: chunk.first)
    return Ensemble(system, rule, members, chunks if kept is None else kept)


def _backend(system: System, rule: Rule, members: Members, wanted: str) -> str:
    """The loop that steps the members; it depends on the input alone, so the same input gives
    the same digits.
    """
    explicit = rule.kicks and system.structure.explicit
    idle = (is_linear(system, rule) and not explicit) or not repays(
        system, rule, members.steps * len(members)
    )
    if wanted == "interpreted" or (wanted == "auto" and idle):
        return "interpreted"
    from varint.codegen.cache import CompileError
    from varint.codegen.graph import NotCompilable
    from varint.codegen.members import members_kernel

    try:
        members_kernel(system, rule)
    except (NotCompilable, CompileError):
        if wanted == "compiled":
            raise
        return "interpreted"
    return "compiled"


def _note(chunk: Chunk) -> str:
    failed = int((chunk.failed >= 0).sum())
    return f"{failed} of the last {len(chunk)} failed" if failed else ""


def load_ensemble(folder: Any, *, trust: bool = False) -> Ensemble:
    """The complete ensemble that ``ensemble(…, store=folder)`` wrote; `varint.load` calls this
    for folders.
    """
    system, rule, members, store = load_store(folder, trust=trust)
    return Ensemble(system, rule, members, store)


def _missing(done: list[tuple[int, int]], total: int) -> list[tuple[int, int]]:
    """Ranges (first, number) that are not among the sorted ones."""
    gaps, at = [], 0
    for first, count in [*done, (total, 0)]:
        if first > at:
            gaps.append((at, first - at))
        at = first + count
    return gaps
