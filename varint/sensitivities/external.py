"""A run as a CasADi function that calls back, with its first derivatives."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from varint.sensitivities.shot import Shot


class External(ca.Callback):
    """A function of NumPy arrays for CasADi: columns first, as CasADi has them."""

    def __init__(
        self,
        name: str,
        inputs: list[tuple[str, tuple[int, int]]],
        outputs: list[tuple[str, tuple[int, int]]],
        value: Callable[[list[np.ndarray]], list[np.ndarray]],
        derivatives: Shot | None = None,
    ):
        ca.Callback.__init__(self)
        self.inputs, self.outputs, self.value, self.shot = inputs, outputs, value, derivatives
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
        return self.shot is not None

    def get_jacobian(self, name: str, inames: list, onames: list, opts: dict) -> ca.Function:
        assert self.shot is not None
        shot, sizes = self.shot, [a * b for _, (a, b) in self.inputs]
        many = self.outputs[0][1][0] * self.outputs[0][1][1]
        ends = np.cumsum([0, *sizes])

        def value(given: list[np.ndarray]) -> list[np.ndarray]:
            whole = shot.jacobian(given[: len(sizes)])
            return [
                whole[i * many : (i + 1) * many, a:b] for i in range(2) for a, b in pairwise(ends)
            ]

        shapes = [(many, size) for _ in range(2) for size in sizes]
        inputs = [*self.inputs, *self.outputs]
        return kept(
            External(
                name,
                [(x, shape) for x, (_, shape) in zip(inames, inputs, strict=True)],
                list(zip(onames, shapes, strict=True)),
                value,
            )
        )

    def has_reverse(self, nadj: int) -> bool:
        return self.shot is not None

    def get_reverse(
        self, nadj: int, name: str, inames: list, onames: list, opts: dict
    ) -> ca.Function:
        assert self.shot is not None
        shot, sizes = self.shot, [a * b for _, (a, b) in self.inputs]
        count, nodes = len(self.inputs), len(shot.nodes)
        ends = np.cumsum([0, *sizes])

        def value(given: list[np.ndarray]) -> list[np.ndarray]:
            of_q, of_v = (x.reshape(nadj, nodes, -1) for x in given[-2:])
            rows = [shot.adjoint(given[:count], a, b) for a, b in zip(of_q, of_v, strict=True)]
            whole = np.array(rows)
            return [whole[:, a:b].ravel() for a, b in pairwise(ends)]

        def wide(shape: tuple[int, int]) -> tuple[int, int]:
            return shape[0], shape[1] * nadj

        shapes = [shape for _, shape in (*self.inputs, *self.outputs)]
        shapes += [wide(shape) for _, shape in self.outputs]
        return kept(
            External(
                name,
                list(zip(inames, shapes, strict=True)),
                [(x, wide(shape)) for x, (_, shape) in zip(onames, self.inputs, strict=True)],
                value,
            )
        )


_ALIVE: list[ca.Callback] = []  # CasADi does not hold what its functions call


def kept(made: External) -> External:
    _ALIVE.append(made)
    return made


def external(name: str, shot: Shot) -> ca.Function:
    n, nodes = shot.system.structure.n, len(shot.nodes)
    inputs = list(zip(("q0", "v0", "params", "u"), shot.sizes, strict=True))
    outputs = [("q", (n, nodes)), ("v", (n, nodes))]
    made = kept(
        External(name, inputs, outputs, lambda x: [y.ravel() for y in shot.values(x)], shot)
    )
    symbols = [ca.MX.sym(x, *shape) for x, shape in inputs]
    # parameters that are left out are the defaults: see `Shot.run`
    options = {"default_in": [0.0, 0.0, np.nan, 0.0]}
    return ca.Function(
        name, symbols, made.call(symbols), [x for x, _ in inputs], ["q", "v"], options
    )
