"""Straight lines of operations on single numbers as instructions of x86-64 with AVX and FMA.

There are sixteen registers. A value that finds none takes that of the one which is needed last
(Belady), which goes to the stack unless it lies in memory already. What lies there is taken from
there by the instruction that needs it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

from varint.codegen.angles import AT_ONCE

REGISTERS = 16
SOON = 8  # operations: a number in memory that is needed again within so many is loaded
NEVER = 1 << 60
INSTRUCTIONS = {
    "add": "vaddsd",
    "mul": "vmulsd",
    "sub": "vsubsd",
    "div": "vdivsd",
    "lt": "vcmpltsd",
    "le": "vcmplesd",
    "eq": "vcmpeqsd",
    "ne": "vcmpneqsd",
    "both": "vandpd",
}
FUSED = {"fma": "vfmadd", "fms": "vfmsub", "fnma": "vfnmadd"}
EITHER_WAY = frozenset(("add", "mul", "eq", "ne", "both"))
SINES = "sines"  # of as many angles as are taken; makes a sine and a cosine of each
BITS = {"neg": "vxorpd", "fabs": "vandpd", "truth": "vandpd"}  # with a constant
DIRECT = frozenset((*INSTRUCTIONS, *FUSED, *BITS, "sqrt"))  # all others are called


class Step(NamedTuple):
    """An operation, the values it defines and those it takes."""

    name: str
    defined: tuple[int, ...]
    taken: tuple[int, ...]


class Frame(NamedTuple):
    """What calls need.

    Attributes
    ----------
    size : int
        Numbers on the stack before those of values.
    angles : int
        Where the angles of `SINES` are among them; sines and cosines of each call behind them.
    sines : str
        What gives these, as an operand.
    again : list of str
        What brings the arguments back behind a call.
    """

    size: int
    angles: int
    sines: str
    again: list[str]


def on_stack(place: int) -> str:
    """The operand of a number there."""
    return f"{8 * place}(%rsp)"


class Registers:
    """Writes the instructions of steps.

    Parameters
    ----------
    memory : mapping
        Where values lie from the beginning: their operand.
    stored : mapping
        Where values are wanted: operands.
    masks : mapping
        The constants of BITS.
    frame : Frame
    """

    def __init__(
        self,
        memory: Mapping[int, str],
        stored: Mapping[int, Sequence[str]],
        masks: Mapping[str, str],
        frame: Frame,
    ) -> None:
        self.home, self.stored, self.masks, self.frame = dict(memory), stored, masks, frame
        self.lines: list[str] = []
        self.register: dict[int, int] = {}
        self.next: dict[int, int] = {}
        self.free = list(range(REGISTERS))
        self.slot: dict[int, int] = {}
        self.slots: list[int] = []  # free ones
        self.left: list[int] = []  # those that are free behind the instruction
        self.room = frame.size
        self.met = 0  # calls for sines

    def write(self, steps: Sequence[Step]) -> None:
        """The instructions of all steps, in their order."""
        following: list[list[int]] = []
        later: dict[int, int] = {}
        for k in range(len(steps) - 1, -1, -1):
            step = steps[k]
            following.append([later.get(i, NEVER) for i in (*step.taken, *step.defined)])
            for i in step.taken:
                later[i] = k
        for k, step in enumerate(steps):
            self.next.update(zip((*step.taken, *step.defined), following.pop(), strict=True))
            if step.name in FUSED:
                self._fused(k, step)
            elif step.name in INSTRUCTIONS:
                self._of_two(k, step)
            elif step.name in BITS or step.name == "sqrt":
                self._of_one(step)
            elif step.name == SINES:
                self._sines(step)
            else:
                self._called(step)
            self.slots += self.left
            self.left.clear()

    def copy(self, values: Iterable[int]) -> None:
        """Store what no step makes."""
        for i in values:
            for place in self.stored[i]:
                self.lines += [f"vmovsd {self.home[i]}, %xmm0", f"vmovsd %xmm0, {place}"]

    def _at(self, i: int) -> str:
        """A value as an operand."""
        return f"%xmm{self.register[i]}" if i in self.register else self.home[i]

    def _take(self, held: Iterable[int]) -> int:
        """A register that is free from now on; none of those of the values held."""
        if not self.free:
            self._leave(max(self.register.keys() - held, key=self.next.__getitem__))
        return heappop(self.free)

    def _leave(self, i: int) -> None:
        """Give a value's register away."""
        number = self.register.pop(i)
        heappush(self.free, number)
        if i not in self.home:
            if not self.slots:
                self.slots.append(self.room)
                self.room += 1
            self.slot[i] = place = self.slots.pop()
            self.home[i] = on_stack(place)
            self.lines.append(f"vmovsd %xmm{number}, {self.home[i]}")

    def _load(self, i: int, held: Iterable[int]) -> None:
        self.register[i] = number = self._take(held)
        self.lines.append(f"vmovsd {self.home[i]}, %xmm{number}")

    def _end(self, values: Iterable[int]) -> None:
        """Forget those values that are not needed any more."""
        for i in set(values):
            if self.next[i] == NEVER:
                if i in self.register:
                    heappush(self.free, self.register.pop(i))
                if i in self.slot:
                    self.left.append(self.slot.pop(i))

    def _made(self, i: int, number: int) -> None:
        """A value is in a register."""
        self.register[i] = number
        for place in self.stored.get(i, ()):
            self.lines.append(f"vmovsd %xmm{number}, {place}")
            self.home.setdefault(i, place)
        self._end((i,))

    def _bring(self, k: int, step: Step) -> None:
        """Load what will be needed again soon."""
        for i in step.taken:
            if i not in self.register and self.next[i] - k < SOON:
                self._load(i, step.taken)

    def _of_two(self, k: int, step: Step) -> None:
        self._bring(k, step)
        first, second = step.taken
        if first not in self.register and second in self.register and step.name in EITHER_WAY:
            first, second = second, first
        if first not in self.register:
            self._load(first, step.taken)
        if second not in self.register and step.name == "both":
            self._load(second, step.taken)
        operands = f"{self._at(second)}, {self._at(first)}"
        self._end(step.taken)
        number = self._take(step.taken)
        self.lines.append(f"{INSTRUCTIONS[step.name]} {operands}, %xmm{number}")
        self._made(step.defined[0], number)

    def _of_one(self, step: Step) -> None:
        (i,) = step.taken
        if i not in self.register:
            self._load(i, step.taken)
        at = self._at(i)
        self._end(step.taken)
        number = self._take(step.taken)
        if step.name == "sqrt":
            self.lines.append(f"vsqrtsd {at}, {at}, %xmm{number}")
        else:
            self.lines.append(f"{BITS[step.name]} {self.masks[step.name]}, {at}, %xmm{number}")
        self._made(step.defined[0], number)

    def _fused(self, k: int, step: Step) -> None:
        """±a b ± c in the place of one of the three, which is lost: of one that is not needed
        again, or of a copy.
        """
        self._bring(k, step)
        a, b, c = step.taken
        outside = [i for i in step.taken if i not in self.register]
        while len(outside) > 1:  # an instruction takes one number from memory, once
            self._load(outside[0], step.taken)
            outside = [i for i in outside if i not in self.register]
        lost = next((i for i in (c, a, b) if i in self.register and self.next[i] == NEVER), None)
        copied = lost is None
        if lost is None:
            lost = next((i for i in (c, a, b) if i not in self.register), c)
        if lost == c:
            order, last = "231", (a, b) if b in self.register else (b, a)
        elif c in self.register:
            order, last = "132", (b if lost == a else a, c)
        else:
            order, last = "213", (c, b if lost == a else a)
        operands = ", ".join(map(self._at, last))
        if copied:
            number, move = self._take(step.taken), "vmovapd" if lost in self.register else "vmovsd"
            self.lines.append(f"{move} {self._at(lost)}, %xmm{number}")
        else:
            number = self.register.pop(lost)
        self._end(step.taken)
        self.lines.append(f"{FUSED[step.name]}{order}sd {operands}, %xmm{number}")
        self._made(step.defined[0], number)

    def _call(self, target: str) -> None:
        """All that is in registers is lost."""
        for i in [*self.register]:
            self._leave(i)
        self.lines += [f"call {target}", *self.frame.again]

    def _called(self, step: Step) -> None:
        """Some other function of one or two numbers."""
        for i in [*self.register]:
            self._leave(i)
        for n, i in enumerate(step.taken):
            self.lines.append(f"vmovsd {self.home[i]}, %xmm{n}")
        self._call(f"called_{step.name}")
        self._end(step.taken)
        self.free.remove(0)
        heapify(self.free)
        self._made(step.defined[0], 0)

    def _sines(self, step: Step) -> None:
        """Sines and cosines of several angles, which lie on the stack one behind the other."""
        angles, sines = self.frame.angles, self.frame.angles + AT_ONCE * (1 + 2 * self.met)
        self.met += 1
        for n, i in enumerate(step.taken):
            if i not in self.register:
                self._load(i, step.taken)
            self.lines.append(f"vmovsd {self._at(i)}, {on_stack(angles + n)}")
        for n in range(len(step.taken), AT_ONCE):
            self.lines.append(f"movq $0, {on_stack(angles + n)}")
        for place, register in zip(
            (angles, sines, sines + AT_ONCE), ("rdi", "rsi", "rdx"), strict=True
        ):
            self.lines.append(f"leaq {on_stack(place)}, %{register}")
        self._end(step.taken)
        self._call(self.frame.sines)
        for n, i in enumerate(step.defined):
            self.home[i] = on_stack(sines + n // 2 + AT_ONCE * (n % 2))
            if i in self.stored:
                self._load(i, ())
                self._made(i, self.register[i])
