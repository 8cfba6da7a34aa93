"""Long functions of single numbers as instructions of x86-64 within C: the assembler takes a
hundredth of the time that a C compiler needs for as many statements.

Every operation rounds as in C and as on a tape, so that the numbers are the same.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Sequence

from varint.codegen.angles import AT_ONCE, together
from varint.codegen.cache import has_instructions
from varint.codegen.dependence import needed, operations_of, sine_and_cosine, uniform_nodes
from varint.codegen.emit import Emitted
from varint.codegen.graph import Graph
from varint.codegen.prepared import PreparedNumbers
from varint.codegen.registers import DIRECT, SINES, Frame, Registers, Step, on_stack

# operations and outputs: shorter functions take the compiler no time, longer ones are better loops
FEWEST, MOST = 100, 20_000
FIRST = "rdi", "rsi", "rdx", "rcx", "r8", "r9"  # of arguments; more of them are on the stack
LOST = *FIRST, "rax", "r10", "r11"  # in a call
KEPT = "rbx", "rbp", "r12", "r13", "r14", "r15"  # by whoever is called
# 16 bytes each, by operations of registers.BITS: all bits but the sign's, its own, and those of 1
MASKS = {"fabs": ((1 << 63) - 1, 0), "neg": (1 << 63, 0), "truth": (0x3FF << 52, 0)}
ZERO, ONE = -1, -2  # values that no graph has
COMPARISONS = frozenset(("lt", "le", "eq", "ne"))
IN_C = """#ifndef CALLED_{0}
#define CALLED_{0}
static __attribute__((noinline, used)) V called_{0}({1}) {{ return v_{0}({2}); }}
#endif
"""


def as_instructions(name: str, graph: Graph, last: int, shared: PreparedNumbers) -> Emitted | None:
    """What `emit_graph` gives of a function of single numbers whose prepared numbers are shared;
    None where C is as good, or the only way.
    """
    if not has_instructions():
        return None
    uniform, live, nodes = uniform_nodes(graph, last), needed(graph), graph.nodes
    count, roots = operations_of(graph, live, uniform)
    if not FEWEST <= count + sum(map(len, graph.outputs)) <= MOST:
        return None
    asked = {nodes[i][1] for i in live if nodes[i][0] == "input" and not uniform[i]}
    filled = [last + 1 + k for k, output in enumerate(graph.outputs) if output]
    at = _pointers([*sorted(asked), last, *filled])
    if at is None:
        return None
    names, numbers = shared.enter(graph, live, uniform), _Numbers(name)
    memory = {ZERO: numbers.place(0.0), ONE: numbers.place(1.0)}
    for i in live:
        kind, *rest = nodes[i]
        if kind == "const":
            memory[i] = numbers.place(rest[0])
        elif uniform[i]:
            memory[i] = f"{8 * shared.place(names[i])}(%{at[last]})"
        elif kind == "input":
            memory[i] = f"{8 * rest[1]}(%{at[rest[0]]})"
    stored: dict[int, list[str]] = defaultdict(list)
    for k, output in enumerate(graph.outputs):
        for row, i in enumerate(output):
            stored[i].append(f"{8 * row}(%{at[last + 1 + k]})")
    steps = _steps(graph, live, uniform)
    frame, begin = _frame(steps, at, at[last])
    code = Registers(memory, stored, numbers.masks(), frame)
    code.write(steps)
    code.copy(i for i in stored if i in memory)
    lines = numbers.lines() + _function(name, at, code.room, begin + code.lines)
    kinds = ["const double *"] * (last + 1) + ["double *"] * len(graph.outputs)
    source = (
        _in_c(steps)
        + f'__attribute__((visibility("hidden"))) void {name}({", ".join(kinds)});\n__asm__(\n'
        + "".join(f'"{line}\\n"\n' for line in lines)
        + ");\n"
    )
    return Emitted(source, 0, count, roots, 0, 0)


class _Numbers:
    """The constants of a function, each once."""

    def __init__(self, name: str) -> None:
        self.table = f".L{name}_numbers"
        self.met: dict[int, int] = {}

    def place(self, x: float) -> str:
        """The operand of a number."""
        (bits,) = struct.unpack("<Q", struct.pack("<d", x))
        k = self.met.setdefault(bits, len(self.met))
        return f"{self.table}+{16 * len(MASKS) + 8 * k}(%rip)"

    def masks(self) -> dict[str, str]:
        """Those of MASKS."""
        return {name: f"{self.table}+{16 * n}(%rip)" for n, name in enumerate(MASKS)}

    def lines(self) -> list[str]:
        """The table, for the assembler."""
        whole = [x for mask in MASKS.values() for x in mask] + [*self.met]
        head = [".pushsection .rodata", ".p2align 4", f"{self.table}:"]
        return [*head, *(f".quad {x}" for x in whole), ".popsection"]


def _pointers(arguments: Sequence[int]) -> dict[int, str] | None:
    """The registers that arguments of a function are in, which come in order; None where they are
    too few.
    """
    found = {k: FIRST[k] for k in arguments if k < len(FIRST)}
    free = [x for x in (*LOST, *KEPT) if x not in found.values()]
    beyond = [k for k in arguments if k >= len(FIRST)]
    if len(beyond) > len(free):
        return None
    return found | dict(zip(beyond, free, strict=False))


def _frame(steps: Sequence[Step], at: dict[int, str], w: str) -> tuple[Frame, list[str]]:
    """What calls need, and what is done for them at first: arguments are kept on the stack."""
    sines = [x.name for x in steps].count(SINES)
    if not sines and all(x.name in DIRECT for x in steps):
        return Frame(0, 0, "", []), []
    lost = [x for x in at.values() if x in LOST]
    begin = [f"movq %{x}, {on_stack(n)}" for n, x in enumerate(lost)]
    again = [f"movq {on_stack(n)}, %{x}" for n, x in enumerate(lost)]
    if not sines:
        return Frame(len(lost), 0, "", again), begin
    # what gives sines stands before w; see c/newton_table.h
    through, angles = on_stack(len(lost)), len(lost) + 1
    begin += [f"movq -8(%{w}), %{lost[0]}", f"movq %{lost[0]}, {through}", again[0]]
    return Frame(angles + AT_ONCE * (1 + 2 * sines), angles, f"*{through}", again), begin


def _function(name: str, at: dict[int, str], room: int, body: Sequence[str]) -> list[str]:
    """The whole function, for the assembler; `room`: numbers on the stack."""
    kept = [x for x in KEPT if x in at.values()]
    size = 8 * (room + (room + len(kept) + 1) % 2)  # where a call is, 16 divides what is in use
    before = size + 8 * (len(kept) + 1) - 8 * len(FIRST)
    return [
        ".pushsection .text",
        ".p2align 5",
        f".type {name}, @function",
        f"{name}:",
        *(f"pushq %{x}" for x in kept),
        f"subq ${size}, %rsp",
        *(f"movq {before + 8 * k}(%rsp), %{x}" for k, x in at.items() if k >= len(FIRST)),
        *body,
        f"addq ${size}, %rsp",
        *(f"popq %{x}" for x in reversed(kept)),
        "ret",
        f".size {name}, .-{name}",
        ".popsection",
    ]


def _in_c(steps: Sequence[Step]) -> str:
    """What is called, in C."""
    found = {x.name: len(x.taken) for x in steps if x.name not in DIRECT and x.name != SINES}
    return "".join(
        IN_C.format(name, ", ".join(f"V {x}" for x in "xy"[:count]), ", ".join("xy"[:count]))
        for name, count in found.items()
    )


def _steps(graph: Graph, live: list[int], uniform: list[bool]) -> list[Step]:
    """The operations on what varies as `Registers` knows them; values between two of them have
    numbers below those of ZERO and ONE.
    """
    pairs = sine_and_cosine(graph, live, uniform)
    steps: list[Step] = []
    for i in live:
        name, *taken = graph.nodes[i]
        between = ONE - 1 - i
        if uniform[i] or name == "input":
            continue
        if i in pairs:
            if any(pairs[i]):
                steps.append(Step(SINES, pairs[i], tuple(taken)))
        elif name == "rsqrt":
            steps.append(Step("sqrt", (between,), tuple(taken)))
            steps.append(Step("div", (i,), (ONE, between)))
        elif name in COMPARISONS:
            steps.append(Step(name, (between,), tuple(taken)))
            steps.append(Step("truth", (i,), (between,)))
        elif name == "not":
            steps.append(Step("eq", (between,), (taken[0], ZERO)))
            steps.append(Step("truth", (i,), (between,)))
        elif name == "if_else_zero":
            steps.append(Step("ne", (between,), (taken[0], ZERO)))
            steps.append(Step("both", (i,), (between, taken[1])))
        else:
            steps.append(Step(name, (i,), tuple(taken)))
    return together(steps, 1, _all_sines) if pairs else steps


def _all_sines(found: Sequence[Step]) -> Step:
    made = tuple(i for x in found for i in x.defined)
    return Step(SINES, made, tuple(i for x in found for i in x.taken))
