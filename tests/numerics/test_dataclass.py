"""Dataclasses made without the compiler are what Python's own are."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
from functools import cached_property
from typing import Any

import pytest

from varint.numerics.dataclass import dataclass, replace

FLAGS = [
    dict(frozen=frozen, eq=eq, repr=shown)
    for frozen in (True, False)
    for eq in (True, False)
    for shown in (True, False)
]
CALLS = [
    ((1,), {}),
    ((1, "two"), {}),
    ((), dict(b="two", a=1)),
    ((1,), dict(d=[3])),
    ((1, "two", None, [4]), {}),
]
WRONG = [
    ((), {}),
    ((1, 2, 3, 4, 5), {}),
    ((1,), dict(a=1)),
    ((1,), dict(colour="red")),
    ((1,), dict(total=3)),
]


def described(decorate: Any, **flags: bool) -> Any:
    """The same class by either decorator."""

    class Sample:
        a: int
        b: str = "b"
        c: Any = dataclasses.field(default=None)
        d: list = dataclasses.field(default_factory=list, repr=False, compare=False)
        total: int = dataclasses.field(init=False)

        def __post_init__(self):
            object.__setattr__(self, "total", 2 * self.a)

        @cached_property
        def double(self) -> int:
            return 2 * self.a

    return decorate(**flags)(Sample)


@pytest.fixture(params=FLAGS, ids=str)
def both(request) -> tuple[Any, Any]:
    """The class by varint's decorator, and by Python's."""
    return described(dataclass, **request.param), described(dataclasses.dataclass, **request.param)


def outcome(run) -> Any:
    try:
        return run()
    except Exception as error:
        return type(error)


@pytest.mark.parametrize("args, given", CALLS)
def test_it_is_made_compared_shown_and_changed_as_pythons_are(both, args, given):
    ours, theirs = (kind(*args, **given) for kind in both)
    assert vars(ours) == vars(theirs)
    assert ours.double == theirs.double == 2
    assert both[0].__match_args__ == both[1].__match_args__
    assert ("Sample(" in repr(ours)) == ("Sample(" in repr(theirs))
    if "Sample(" in repr(theirs):
        assert repr(ours) == repr(theirs)
    again, changed = replace(ours, a=5), dataclasses.replace(theirs, a=5)
    assert vars(replace(theirs, a=5)) == vars(dataclasses.replace(ours, a=5)) == vars(again)
    assert vars(again) == {k: v for k, v in vars(changed).items() if k != "double"}
    assert [x.name for x in dataclasses.fields(ours)] == [
        x.name for x in dataclasses.fields(theirs)
    ]
    assert dataclasses.asdict(ours) == dataclasses.asdict(theirs)
    twin, their_twin = (copy.copy(x) for x in (ours, theirs))
    assert (twin == ours) is (their_twin == theirs)
    assert (again == ours) is (changed == theirs) is False
    assert ours != theirs
    changes = [
        lambda x: setattr(x, "a", 3),
        lambda x: delattr(x, "b"),
        lambda x: setattr(x, "e", 1),
    ]
    for change in changes:
        assert outcome(lambda c=change: c(ours)) == outcome(lambda c=change: c(theirs))
    assert vars(ours) == vars(theirs)


@pytest.mark.parametrize("args, given", WRONG)
def test_what_it_cannot_be_made_of_is_refused_by_name(both, args, given):
    for kind in both:
        with pytest.raises(TypeError) as refused:
            kind(*args, **given)
        for name in given:
            assert name in str(refused.value)


def test_hashes_are_those_of_the_values_where_nothing_changes(both):
    pairs = [(kind(1, "b"), kind(1, "b")) for kind in both]
    ours, theirs = (outcome(lambda p=pair: hash(p[0]) == hash(p[1])) for pair in pairs)
    assert ours is theirs


def test_its_signature_is_the_one_of_pythons(both):
    ours, theirs = (inspect.signature(kind).parameters for kind in both)
    assert list(ours) == list(theirs)
    assert all(ours[name].kind == theirs[name].kind for name in theirs)
    plain = [name for name in theirs if name != "d"]  # the default of d is made
    assert all(ours[name] == theirs[name] for name in plain)
    assert ours["d"].default is not inspect.Parameter.empty


def test_what_a_class_defines_itself_stays():
    def whole(decorate: Any) -> Any:
        class Whole:
            a: int

            def __init__(self, a: int, factor: int):
                object.__setattr__(self, "a", a * factor)

            def __eq__(self, other):
                return self.a % 2 == other.a % 2

            def __repr__(self):
                return "whole"

        return decorate(frozen=True)(Whole)

    ours, theirs = whole(dataclass), whole(dataclasses.dataclass)
    assert ours(1, 2) == ours(2, 3) and ours(1, 1) != ours(2, 1) and repr(ours(1, 2)) == "whole"
    assert hash(ours(1, 2)) == hash(theirs(1, 2))
    assert inspect.signature(ours) == inspect.signature(theirs)


def test_a_default_that_instances_would_share_is_refused():
    class Shared:
        a: list = []  # noqa: RUF012

    for decorate in (dataclass, dataclasses.dataclass):
        with pytest.raises(ValueError, match="default"):
            decorate(type("Shared", (), dict(vars(Shared))))


@dataclass(frozen=True)
class Sent:
    """What another process takes."""

    a: int
    b: tuple = ()


def test_it_travels_to_other_processes_and_shows_itself_within_itself():
    sent = Sent(1, (Sent(2),))
    assert pickle.loads(pickle.dumps(sent)) == sent and hash(sent) == hash(copy.deepcopy(sent))
    held: list = []
    around = Sent(1, (held,))
    held.append(around)
    assert repr(around) == "Sent(a=1, b=([...],))"


FIRST = """
import dataclasses, sys
import casadi as ca
import varint as vi
q, v = vi.coordinates("x")
force = ca.SX.sym("force")
cart = vi.System(q, v, v**2 / 2, force=force, control=force)
vi.simulate(cart, q0=0, v0=1, h=0.1, steps=3, u=0)
ends = dict(q0=0, v0=0, end=dict(q=[1], v=[0]))
vi.optimal_control(cart, vi.gauss(2), duration=1, steps=5, cost=force**2, **ends)
for name, module in sorted(sys.modules.items()):
    if name.startswith("varint") and getattr(module, "dataclass", None) is dataclasses.dataclass:
        print(name)
"""


def test_a_first_run_and_a_first_optimal_control_compile_no_methods_of_classes():
    command = [sys.executable, "-c", FIRST]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not found.stdout.split()
