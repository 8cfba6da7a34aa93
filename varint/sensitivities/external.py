"""A run as a CasADi function that calls back, with its first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.sensitivities.contact_shot import ContactShot
from varint.sensitivities.shot import Shot

Arrays = list[np.ndarray]
Shapes = list[tuple[str, tuple[int, int]]]


class External(ca.Callback):
    """A function of NumPy arrays for CasADi, flat ones, columns first as CasADi has them.

    `jacobian` gives the derivatives of every output by every input in turn, as matrices, `curved`
    those of all of them as of the outputs of a function; `reverse` is the function that pulls so
    many rows back.
    """

    def __init__(
        self,
        name: str,
        inputs: Shapes,
        outputs: Shapes,
        value: Callable[[Arrays], Arrays],
        jacobian: Callable[[Arrays], Arrays] | None = None,
        reverse: Callable[[int, str, list, list], ca.Function] | None = None,
        curved: Callable[[Arrays], Arrays] | None = None,
    ):
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.value = inputs, outputs, value
        self.jacobian_of, self.reverse_of, self.curved = jacobian, reverse, curved
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_name_in(self, i: int) -> str:
        return self.inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self.outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self.inputs[i][1])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self.outputs[i][1])

    def eval(self, arguments: list[ca.DM]) -> list[Any]:
        given = [np.array(x.full().ravel(order="F")) for x in arguments]
        found = self.value(given)
        shapes = (shape for _, shape in self.outputs)
        return [ca.DM(x.reshape(shape, order="F")) for x, shape in zip(found, shapes, strict=True)]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inames: list, onames: list, opts: dict) -> ca.Function:
        jacobian, curved, count = self.jacobian_of, self.curved, len(self.inputs)
        if jacobian is None:
            raise InputError(
                "a flow has first and second derivatives, no third ones: where a solver asks for "
                "those, give it an approximation (ipopt.hessian_approximation='limited-memory')"
            )
        again = None if curved is None else lambda x: curved(x[:count])
        shapes = [(a[0] * a[1], b[0] * b[1]) for _, a in self.outputs for _, b in self.inputs]
        inputs = zip(inames, (shape for _, shape in (*self.inputs, *self.outputs)), strict=True)
        outputs = list(zip(onames, shapes, strict=True))
        return kept(External(name, list(inputs), outputs, lambda x: jacobian(x[:count]), again))

    def has_reverse(self, nadj: int) -> bool:
        return self.reverse_of is not None

    def get_reverse(
        self, nadj: int, name: str, inames: list, onames: list, opts: dict
    ) -> ca.Function:
        assert self.reverse_of is not None
        return self.reverse_of(nadj, name, inames, onames)


_ALIVE: list[ca.Callback] = []  # CasADi does not hold what its functions call


def kept(made: External) -> External:
    _ALIVE.append(made)
    return made


def external(name: str, shot: Shot | ContactShot) -> ca.Function:
    """The run as a function (q0, v0, params, u) → q, v."""
    n, nodes = shot.system.structure.n, len(shot.nodes)
    inputs = list(zip(("q0", "v0", "params", "u"), shot.sizes, strict=True))
    outputs = [("q", (n, nodes)), ("v", (n, nodes))]
    ends = np.cumsum([0, *(a * b for a, b in shot.sizes)])

    def jacobian(given: Arrays) -> Arrays:
        rows = np.split(shot.jacobian(given), 2)
        return [part[:, a:b] for part in rows for a, b in pairwise(ends)]

    def curved(given: Arrays) -> Arrays:
        """Derivatives of every block of the Jacobian, by inputs and values."""
        unit = np.eye(2 * n * nodes).reshape(-1, 2, nodes, n)
        tensors = np.split(np.array([shot.hessian(given, *one) for one in unit]), 2)
        blocks = []
        for part in tensors:
            for a, b in pairwise(ends):
                rows = part[:, a:b].transpose(1, 0, 2).reshape((b - a) * n * nodes, ends[-1])
                blocks += [rows[:, i:j] for i, j in pairwise(ends)]
                blocks += [np.zeros((len(rows), n * nodes))] * 2
        return blocks

    def reverse(nadj: int, name: str, inames: list, onames: list) -> ca.Function:
        return _pulled_back(shot, nadj, name, inputs, outputs, inames, onames)

    def value(given: Arrays) -> Arrays:
        return [x.ravel() for x in shot.values(given)]

    made = kept(External(name, inputs, outputs, value, jacobian, reverse, curved))
    symbols = [ca.MX.sym(x, *shape) for x, shape in inputs]
    # parameters that are left out are the defaults: see `Shot.run`
    options = {"default_in": [0.0, 0.0, np.nan, 0.0]}
    return ca.Function(
        name, symbols, made.call(symbols), [x for x, _ in inputs], ["q", "v"], options
    )


def _pulled_back(
    shot: Shot | ContactShot,
    nadj: int,
    name: str,
    inputs: Shapes,
    outputs: Shapes,
    inames: list,
    onames: list,
) -> ca.Function:
    """(inputs, outputs, rows) → the rows times the Jacobian, `nadj` at once; its own Jacobian has
    the second derivatives of the run.
    """
    count, nodes = len(inputs), len(shot.nodes)
    ends = np.cumsum([0, *(a * b for a, b in shot.sizes)])

    def rows(given: Arrays) -> list[tuple[np.ndarray, np.ndarray]]:
        of_q, of_v = (x.reshape(nadj, nodes, -1) for x in given[-2:])
        return list(zip(of_q, of_v, strict=True))

    def value(given: Arrays) -> Arrays:
        whole = np.array([shot.adjoint(given[:count], a, b) for a, b in rows(given)])
        return [whole[:, a:b].ravel() for a, b in pairwise(ends)]

    def jacobian(given: Arrays) -> Arrays:
        by_outputs = np.split(shot.jacobian(given[:count]), 2)
        curved = [shot.hessian(given[:count], a, b) for a, b in rows(given)]
        blocks = []
        for a, b in pairwise(ends):
            by_inputs = np.vstack([x[a:b] for x in curved])
            blocks += [by_inputs[:, i:j] for i, j in pairwise(ends)]
            blocks += [np.zeros((len(by_inputs), len(x))) for x in by_outputs]
            blocks += [np.kron(np.eye(nadj), x[:, a:b].T) for x in by_outputs]
        return blocks

    def wide(shape: tuple[int, int]) -> tuple[int, int]:
        return shape[0], shape[1] * nadj

    shapes = [shape for _, shape in (*inputs, *outputs)] + [wide(shape) for _, shape in outputs]
    given = list(zip(inames, shapes, strict=True))
    found = [(x, wide(shape)) for x, (_, shape) in zip(onames, inputs, strict=True)]
    return kept(External(name, given, found, value, jacobian))
