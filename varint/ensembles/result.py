"""The result of `ensemble`: arrays with a leading axis of members, single trajectories,
statistics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.discrete.legendre import velocity_function
from varint.ensembles.chosen import chosen_member
from varint.ensembles.chunk import Chunk
from varint.ensembles.executor import MOST_NUMBERS
from varint.ensembles.members import Members
from varint.ensembles.single import error_of, member_of, nodes_of
from varint.errors import ConvergenceError, InputError
from varint.numerics.arrays import over_columns
from varint.results.trajectory import Trajectory
from varint.rules.rule import Rule
from varint.scene.expressions import values_of
from varint.scene.inputs import finite_array
from varint.scene.system import System, parameters_by_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ALL = slice(None)
PANELS = 2  # coordinates in the small picture of notebooks


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """Many motions on one time grid; arrays have members first, then time.

    A member that failed has only the nodes before its failure: arrays are masked behind them, and
    `errors` keeps its error. Statistics are over the members that completed.

    Attributes
    ----------
    system : System
        What moved.
    rule : Rule or None
        By which discretisation; None where each member has its own, that of ``ensemble[i].rule``.
    members : Members
        Starts, parameters and controls of the members, and where steps are chosen how.
    chunks : sequence of Chunk
        The motions, members in order; read from the disk one by one where the ensemble has a store.
    """

    system: System
    rule: Rule | None
    members: Members
    chunks: Sequence[Chunk]

    def __len__(self) -> int:
        return len(self.members)

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if len(self.failed) else ""
        how = self._accuracy or str(self.rule)
        return f"Ensemble({len(self)} members × {len(self.k)} nodes, {how}{failed})"

    def _repr_html_(self) -> str:
        """For notebooks: a short table, and the spread of the first coordinates over time."""
        from varint.drawing.notebook import ensemble_html

        order = self.rule and self.rule.order
        rows = [
            ("members", f"{len(self)}, {len(self.failed)} failed"),
            ("nodes", f"{len(self.k)}, t = {self.t[0]:.6g} … {self.t[-1]:.6g}"),
            ("rule", self._accuracy or f"{self.rule}, order {order}, h = {self.h:.6g}"),
        ]
        q = self.system.q[:PANELS] if len(self.completed) else self.system.q[:0]
        shown = self.system.names[: q.numel()]
        levels = [self.quantiles(x, (0.05, 0.25, 0.5, 0.75, 0.95)) for x in ca.vertsplit(q)]
        return ensemble_html(shown, self.t, np.array(levels[: len(shown)]), rows)

    @property
    def _accuracy(self) -> str:
        """In words how steps are chosen; nothing where they are given."""
        if self.members.asked is None:
            return ""
        rule = f"{self.rule}, " if self.rule else ""
        return f"{rule}steps for tol = {self.members.asked.tol:g}"

    def __getstate__(self) -> dict[str, Any]:
        """What travels to another process: the fields, not what follows from them."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __getitem__(self, i: int | str) -> Any:
        """``ensemble["theta"]`` is the values (M, N + 1) of what has that name, ``ensemble[i]`` the
        trajectory of one member, up to its failure if it failed; one with contacts, or whose
        steps are chosen, is run again. With contacts it has all nodes of its own where steps are
        given, and else those of the ensemble.
        """
        if isinstance(i, str):
            return self.value(i)
        if not isinstance(i, (int, np.integer)):
            raise InputError(
                f"ensemble[i] is the motion of one member, or what has a name, got [{i!r}]; "
                "write [ensemble[i] for i in …] for several"
            )
        i = range(len(self))[i]
        if self.members.asked is not None:
            return chosen_member(self.system, self.rule, self.members, i)
        at = int(np.searchsorted(self._firsts, i, side="right")) - 1
        return self._motion(self.chunks[at], i - int(self._firsts[at]))

    def __iter__(self) -> Iterator[Trajectory]:
        return (self._motion(chunk, j) for chunk in self.chunks for j in range(len(chunk)))

    def _motion(self, chunk: Chunk, j: int) -> Trajectory:
        """The trajectory of member j of a chunk."""
        return member_of(self.system, self.rule, self.members, chunk, j)

    @property
    def k(self) -> np.ndarray:
        """Whole steps before each node, (N + 1,); the nodes' numbers where steps are chosen."""
        return self.members.k

    @property
    def t(self) -> np.ndarray:
        """Times of the nodes, (N + 1,)."""
        return self.members.t

    @property
    def h(self) -> float | None:
        """Step size; None where each member has its own, that of ``ensemble[i].h``."""
        return self.members.h if self.members.asked is None else None

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Parameter values by name, members first."""
        rows = [parameters_by_name(self.system, self.members.of("c", i)) for i in range(len(self))]
        return {name: np.array([row[name] for row in rows]) for name in self.system.defaults}

    @cached_property
    def _firsts(self) -> np.ndarray:
        sizes = getattr(self.chunks, "sizes", None) or [len(chunk) for chunk in self.chunks]
        return np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int)

    @cached_property
    def good(self) -> np.ndarray:
        """Number of solved nodes of every member."""
        return np.concatenate([chunk.good for chunk in self.chunks])

    @cached_property
    def failed(self) -> np.ndarray:
        """Numbers of the members that failed."""
        return np.flatnonzero(np.concatenate([chunk.failed for chunk in self.chunks]) >= 0)

    @cached_property
    def completed(self) -> np.ndarray:
        """Numbers of the members that did not."""
        return np.setdiff1d(np.arange(len(self)), self.failed)

    @cached_property
    def steps(self) -> np.ndarray:
        """Steps done by every member, (members,)."""
        return np.concatenate([chunk.step for chunk in self.chunks])

    @cached_property
    def error_estimate(self) -> np.ndarray:
        """Estimated error of every member whose steps were chosen, in parts of its scale,
        (members,); NaN where h or steps were given, and for members that failed.
        """
        return np.concatenate([chunk.estimate for chunk in self.chunks])

    @cached_property
    def errors(self) -> dict[int, ConvergenceError]:
        """The error of every failed member, as `simulate` raises it."""
        what = self.system, self.rule, self.members
        return {
            chunk.first + j: error_of(*what, chunk, j)
            for chunk in self.chunks
            for j in np.flatnonzero(chunk.failed >= 0).tolist()
        }

    @cached_property
    def q(self) -> np.ndarray:
        """Coordinates, (members, N + 1, n); masked behind the last good node of a failed member."""
        return self._array("q")

    @cached_property
    def p(self) -> np.ndarray:
        """Momenta ∂L/∂v, (members, N + 1, n), masked like `q`."""
        return self._array("p")

    @cached_property
    def v(self) -> np.ndarray:
        """Velocities, (members, N + 1, n), masked like `q`."""
        return self.value(self.system.v).reshape(len(self), len(self.k), -1)

    @cached_property
    def energy(self) -> np.ndarray:
        """Energies, (members, N + 1), masked like `q`."""
        return self.value(self.system.energy)

    def value(self, expression: Any) -> np.ndarray:
        """Value of an expression at every node of every member, as `Trajectory.value`: (members, N
        + 1, …).

        Raises
        ------
        InputError
            If the expression has symbols that the system does not know.
        """
        return self._joined(self.values(expression))

    def values(self, expression: Any) -> list[np.ndarray]:
        """Values of an expression along each member, one array a member, as long as it got."""
        return [part for _, parts in self._by_chunk(expression) for part in parts]

    def _by_chunk(
        self, expression: Any, part: slice = ALL
    ) -> Iterator[tuple[Chunk, list[np.ndarray]]]:
        """Values along the members of each chunk at some nodes: never more than one chunk is in
        memory.
        """
        function, s = values_of(self.system, expression), self.system.structure
        rows, columns = function.size_out(0)
        shape = () if columns == rows == 1 else (rows,) if columns == 1 else (columns, rows)
        pushed = function.jac_sparsity(0, 3).nnz() > 0  # by controls
        for chunk in self.chunks:
            if not (pushed or s.constraints or s.nonholonomic or s.contacts):
                yield chunk, list(self._along(chunk, function, shape, part))
            else:
                what = self.system, self.rule, self.members, chunk
                nodes = (nodes_of(*what, j) for j in range(len(chunk)))
                nothing = np.empty((0, *shape[::-1]))
                yield (
                    chunk,
                    [
                        nothing if motion is None else motion.evaluated(function)[at[part]]
                        for motion, at in nodes
                    ],
                )

    def _along(
        self, chunk: Chunk, function: ca.Function, shape: tuple[int, ...], part: slice
    ) -> Iterator[np.ndarray]:
        """Values for all members of a chunk at once."""
        have = np.arange(len(self.k))[part] < chunk.good[:, None]
        member, node = np.nonzero(have)
        c = self.members.c[chunk.first + member]
        q, p, t = chunk.q[:, part][have], chunk.p[:, part][have], self.t[part][node, None]
        v = over_columns(velocity_function(self.system), q, p, t, c)[0]
        u = np.zeros((len(t), self.system.structure.controls))  # which play no part
        flat = over_columns(function, q, v, t, u, c)[0].reshape(-1, *shape)
        flat = flat.swapaxes(1, 2) if len(shape) == 2 else flat
        return iter(np.split(flat, np.cumsum(have.sum(axis=1))[:-1]))

    def mean(self, expression: Any) -> np.ndarray:
        """Mean over the completed members at every node, (N + 1, …); chunk by chunk, whatever
        they are.
        """
        total, count = np.zeros(()), 0
        for rows in self._completed(expression):
            for row in rows:
                total = total + row
            count += len(rows)
        return total / count

    def std(self, expression: Any) -> np.ndarray:
        """Standard deviation (of the sample) over the completed members at every node, (N + 1,
        …).
        """
        if len(self.completed) == 1:
            raise InputError("a standard deviation needs two members that completed; there is one")
        middle, total = self.mean(expression), np.zeros(())
        for rows in self._completed(expression):
            for row in rows:
                total = total + (row - middle) ** 2
        return np.sqrt(total / (len(self.completed) - 1))

    def quantiles(self, expression: Any, levels: Sequence[float] = (0.05, 0.5, 0.95)) -> np.ndarray:
        """Quantiles over the completed members at every node, (levels, N + 1, …)."""
        wanted = finite_array("levels", levels).reshape(-1)
        if not wanted.size or wanted.min() < 0 or wanted.max() > 1:
            raise InputError(f"levels must lie between 0 and 1, got {levels!r}")
        size = values_of(self.system, expression).numel_out(0)
        # nodes of all members held at once
        width = max(MOST_NUMBERS // max(len(self.completed) * size, 1), 1)
        parts = []
        for a in range(0, len(self.k), width):
            rows = np.concatenate(list(self._completed(expression, slice(a, a + width))))
            parts.append(np.quantile(rows, wanted, axis=0))
        return np.concatenate(parts, axis=1)

    def plot(self, *expressions: Any) -> Figure:
        """Figure of the spread over time: median, quartiles and the middle 90 %, of the
        coordinates by default.
        """
        from varint.drawing.ensemble_figures import ensemble_figure

        how = self._accuracy or f"{self.rule}, h = {self.h:.4g}"
        title = f"{len(self.completed)} members, {how}"
        return ensemble_figure(self.system, self.t, self.quantiles, title, *expressions)

    def _completed(self, expression: Any, part: slice = ALL) -> Iterator[np.ndarray]:
        """Values of the members that completed at some nodes, (members, nodes, …), chunk by
        chunk.
        """
        if not len(self.completed):
            raise InputError("no member completed; Ensemble.errors says why")
        for chunk, parts in self._by_chunk(expression, part):
            rows = [part for part, failed in zip(parts, chunk.failed, strict=True) if failed < 0]
            if rows:
                yield np.array(rows)

    def _array(self, name: str) -> np.ndarray:
        return self._masked(np.concatenate([getattr(chunk, name) for chunk in self.chunks]))

    def _joined(self, parts: list[np.ndarray]) -> np.ndarray:
        whole = np.zeros((len(parts), len(self.k), *parts[0].shape[1:]))
        for row, part in zip(whole, parts, strict=True):
            row[: len(part)] = part
        return self._masked(whole)

    def _masked(self, array: np.ndarray) -> np.ndarray:
        if not len(self.failed):
            return array
        missing = np.arange(len(self.k)) >= self.good[:, None]
        shape = missing.shape + (1,) * (array.ndim - 2)
        return np.ma.array(array, mask=np.broadcast_to(missing.reshape(shape), array.shape))
