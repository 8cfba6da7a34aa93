"""What C functions take that depends on the parameters alone: each number once."""

from __future__ import annotations

import math
from collections.abc import Sequence

from varint.codegen.graph import Graph
from varint.codegen.parts import LARGEST
from varint.codegen.pieces import APART, c_function
from varint.codegen.rolled import INFIX, c_expression


class PreparedNumbers:
    """The numbers w that are prepared for one function, or for several that share them.

    Parameters
    ----------
    parameters : int
        So many parameters stand first in w, where others have put them: they need no statement.
    """

    def __init__(self, parameters: int = 0) -> None:
        self.parameters = parameters
        self.statements: list[str] = []
        self._known: dict[str, str] = {}  # expression: its name
        self._kept: dict[str, int] = {}  # name: its place in w

    def enter(self, graph: Graph, live: Sequence[int], uniform: Sequence[bool]) -> dict[int, str]:
        """C texts of the uniform nodes of a function, as they are prepared."""
        names: dict[int, str] = {}
        for i in live:
            if uniform[i]:
                name, *rest = graph.nodes[i]
                if name == "const":
                    names[i] = c_number(rest[0])
                elif name == "input":
                    names[i] = f"c[{rest[1]}]"
                else:
                    names[i] = self._computed(_once(name, [names[j] for j in rest]))
        return names

    def _computed(self, expression: str) -> str:
        if expression not in self._known:
            self._known[expression] = name = f"s{len(self._known)}"
            self.statements.append(f"const double {name} = {expression};")
        return self._known[expression]

    def place(self, name: str) -> int:
        """Where in w the number is found."""
        if self.parameters and name.startswith("c["):
            return int(name[2:-1])
        return self._kept.setdefault(name, self.parameters + len(self._kept))

    def __len__(self) -> int:
        return self.parameters + len(self._kept)

    def source(self, name: str, rare: bool = False) -> str:
        """The C function ``name_prepare(c, w)``; `rare` as in `emit_graph`."""
        body = self.statements + [f"w[{place}] = {x};" for x, place in self._kept.items()]
        kind = "RARE" if rare else "INLINE" if len(body) <= LARGEST else APART
        return c_function(kind, f"{name}_prepare", ["const double *c", "double *w"], body)


def c_number(x: float) -> str:
    """C text of a number."""
    if math.isfinite(x):
        return f"({float(x)!r})" if x < 0 else repr(float(x))
    return "(0.0 / 0.0)" if math.isnan(x) else ("(1.0 / 0.0)" if x > 0 else "(-1.0 / 0.0)")


def _once(name: str, operands: list[str]) -> str:
    """C expression of an operation on plain numbers."""
    if name in INFIX or name == "neg":
        return c_expression(name, operands, [True] * len(operands))
    return f"s_{name}({', '.join(operands)})"
