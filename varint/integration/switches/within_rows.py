"""Controls that vary within the rows of their table, beside switches: forces that depend on time.

In a row from t₀ of length H they are polynomials, u(t) = Σ uⱼ ℓⱼ((t − t₀)/H) through the values at
the nodes of a rule. Of a scene in which that is written out, t₀, 1/H and all uⱼ are controls that
stay as they are in each row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet
from varint.errors import InputError
from varint.integration.problem import InitialValueProblem
from varint.integration.switches.branch import Branch, BranchScene
from varint.integration.switches.joined import BetweenNodes, between_nodes
from varint.integration.switches.touching import scene_in
from varint.results.records import whole_of
from varint.results.trajectory import Trajectory
from varint.rules.polynomials import lagrange_values
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System

CONTROL_NODES = "control_nodes"  # array in files
BEGINS, PACE, VALUES = 0, 1, 2  # places among the controls of the scene that is written out


@per_system
def written_out(system: System, nodes: tuple[float, ...]) -> System:
    """The scene whose controls are polynomials of time: t₀, 1/H, then the values at each node."""
    s, k = system, system.control.numel()
    w = ca.SX.sym("within", VALUES + len(nodes) * k)
    share = (s.t - w[BEGINS]) * w[PACE]
    u = ca.SX.zeros(k)
    for j, node in enumerate(nodes):
        others = [(share - x) / (node - x) for x in nodes if x != node]
        weight = ca.SX(1)
        for factor in others:
            weight *= factor
        u += weight * w[VALUES + j * k : VALUES + (j + 1) * k]
    lagrangian, force = ca.substitute([s.lagrangian, s.force], [s.control], [u])
    return System(
        s.q,
        s.v,
        lagrangian,
        force=ca.sparsify(force),
        control=w,
        constraint=s.constraint,
        nonholonomic=s.nonholonomic,
        contact=s.contact if s.structure.contacts else None,
        restitution=s.bounce if s.structure.contacts else 0.0,
        params=s.params,
        t=s.t,
        kinetics=s.kinetics,
        rays=s.rays,
    )


def rows_written_out(problem: InitialValueProblem) -> InitialValueProblem:
    """The same problem for the scene that is written out, one value a row."""
    rows, h = len(problem.u), problem.h
    begin = problem.t0 + h * np.arange(rows)
    pace = np.full(rows, 1 / h)
    u = np.hstack([begin[:, None], pace[:, None], problem.u.reshape(rows, -1)])
    return problem._replace(u=np.ascontiguousarray(u[:, None]))


def _values(nodes: tuple[float, ...], w: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Controls (N, r, k) at times (N, r) in rows with these controls of the other scene, (N, …)."""
    share = (t - w[:, BEGINS, None]) * w[:, PACE, None]
    values = w[:, VALUES:].reshape(len(w), len(nodes), -1)
    weights = lagrange_values(np.array(nodes), share.ravel()).reshape(*share.shape, len(nodes))
    return np.asarray(np.einsum("nri,nik->nrk", weights, values))


@dataclass(frozen=True, eq=False)
class WithinRows:
    """Dense output of a motion whose controls vary within rows.

    Attributes
    ----------
    between : BetweenNodes
        That of the scene that is written out.
    nodes : tuple of float
        Where in a row the table has values, of its length.
    """

    between: BetweenNodes
    nodes: tuple[float, ...]

    @property
    def branches(self) -> tuple[Branch, ...]:
        """Those of the scene that is written out."""
        return self.between.branches

    def to_arrays(self) -> dict[str, np.ndarray]:
        """What a file holds of it."""
        return self.between.to_arrays() | {CONTROL_NODES: np.array(self.nodes)}

    def __call__(self, motion: Trajectory, times: np.ndarray) -> Trajectory:
        inner = replace(motion, system=written_out(motion.system, self.nodes))
        found = self.between(inner, times)
        w = np.array([x.controls for x in self.branches])[self.between.branch[found.k]]
        u = _values(self.nodes, w, times[:, None])
        k, whole = np.arange(len(times)), whole_of(motion)
        return replace(found, system=motion.system, u=u, k=k, whole=whole)


def of_users_scene(system: System, nodes: tuple[float, ...], motion: Trajectory) -> Trajectory:
    """A motion of the scene that is written out as one of the user's, controls at the nodes of its
    own rule.
    """
    between, sizes = motion.dense_output, motion.sizes
    assert isinstance(between, BetweenNodes) and sizes is not None and motion.origin is not None
    begin = motion.origin + np.append(0.0, np.cumsum(sizes))[:-1]
    times = begin[:, None] + sizes[:, None] * np.array(motion.rule.nodes)
    found = replace(
        motion,
        system=system,
        u=_values(nodes, motion.u[:, 0], times),
        dense_output=WithinRows(between, nodes),
    )
    found.__dict__["v"] = motion.v
    return found


def dense_output_of(
    system: System, rule: Rule, arrays: dict[str, np.ndarray]
) -> BetweenNodes | WithinRows:
    """The dense output of which a file holds these arrays.

    Raises
    ------
    InputError
        If they are none of this system.
    """
    if CONTROL_NODES not in arrays:
        return between_nodes(system, rule, arrays)
    nodes = arrays[CONTROL_NODES]
    if nodes.ndim != 1 or nodes.dtype.kind != "f" or len(np.unique(nodes)) != len(nodes):
        raise InputError("the controls within rows are not at different nodes")
    rest = {name: x for name, x in arrays.items() if name != CONTROL_NODES}
    places = tuple(nodes.tolist())
    return WithinRows(between_nodes(written_out(system, places), rule, rest), places)


def first_scene(system: System, between: BetweenNodes | WithinRows) -> BranchScene:
    """The scene in which a motion begins."""
    own = written_out(system, between.nodes) if isinstance(between, WithinRows) else system
    scene = scene_in(own, between.branches[0])
    assert scene is not None
    return scene


def sets_of(between: BetweenNodes | WithinRows) -> tuple[ActiveSet, ...]:
    """The active sets that occur, where contacts may hold."""
    return tuple(dict.fromkeys(x.active_set for x in between.branches if x.active_set is not None))
