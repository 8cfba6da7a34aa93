"""What is built for one scene serves all that are made alike, and no other."""

import gc
import pickle
import weakref

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.native import native_gauss
from varint.codegen.native_newton import native_newton
from varint.scene import alike
from varint.scene.alike import first_alike
from varint.scene.memory import per_scene


def spring(k: float = 4.0, quartic: float = 0.5, name: str = "x", **more) -> vi.System:
    q, v = vi.coordinates(name)
    stiffness = ca.SX.sym("k")
    return vi.System(
        q, v, v**2 / 2 - stiffness * q**2 / 2 - quartic * q**4, params={stiffness: k}, **more
    )


def test_a_scene_made_again_is_arranged_once_whatever_its_parameters(forget):
    one, other = spring(4.0), spring(9.0)
    assert one is not other and first_alike(other) is first_alike(one)
    assert native_gauss(one, vi.gauss(4)) is native_gauss(other, vi.gauss(4))
    assert native_newton(one, vi.lobatto(3)) is native_newton(other, vi.lobatto(3))
    assert one.structure is other.structure
    run = {"q0": 1.0, "v0": 0.0, "h": 0.05, "steps": 40}
    given = vi.simulate(one, vi.gauss(4), **run, params={"k": 9.0})
    own = vi.simulate(other, vi.gauss(4), **run)
    assert own.q.tobytes() == given.q.tobytes() and own.system is other
    assert np.abs(own.q - vi.simulate(one, vi.gauss(4), **run).q).max() > 0.1
    forget()
    alone = vi.simulate(spring(9.0), vi.gauss(4), **run)
    assert alone.q.tobytes() == own.q.tobytes() and alone.energy.tobytes() == own.energy.tobytes()


def test_every_difference_tells_scenes_apart(forget):
    """A digit, a name, a force, what bounces: another scene."""
    q, v = vi.coordinates("x")
    plain = vi.System(q, v, v**2 / 2 - q**2)
    scenes = [
        spring(),
        spring(quartic=float(np.nextafter(0.5, 1))),
        spring(name="y"),
        plain,
        vi.System(q, v, v**2 / 2 - q**2, force=-v),
        vi.System(q, v, v**2 / 2 - q**2, constraint=q),
        vi.System(q, v, v**2 / 2 - q**2, contact=q),
        vi.System(q, v, v**2 / 2 - q**2, contact=q, restitution=0.5),
        vi.System(q, v, v**2 / 2 - q**2, nonholonomic=ca.SX([[1.0]])),
    ]
    for scene in scenes:
        assert first_alike(scene) is scene
    for copy in (pickle.loads(pickle.dumps(plain)), vi.System(q, v, v**2 / 2 - q**2)):
        assert first_alike(copy) is plain


def test_where_ranks_decide_values_of_parameters_belong_to_the_scene(forget):
    """With constraints the default masses say which equations are solved."""

    def rod(mass: float) -> vi.System:
        q, v = vi.coordinates("x", "y")
        m = ca.SX.sym("m")
        return vi.System(
            q, v, m * ca.sumsqr(v) / 2 + v[0] * v[1], constraint=ca.sumsqr(q) - 1, params={m: mass}
        )

    assert first_alike(rod(2.0)) is first_alike(rod(2.0))
    assert first_alike(rod(2.0)) is not first_alike(rod(1.0))


def test_a_refusal_is_shared_and_an_error_is_not(forget):
    asked = []

    def build(system, answer):
        asked.append(system)
        if answer is None:
            raise vi.InputError("not now")
        return answer

    once = per_scene(build)
    with pytest.raises(vi.InputError):
        once(spring(), None)
    assert once(spring(), "first") == once(spring(), "first") == "first"
    assert len(asked) == 2 and asked[0] is asked[1]


def test_only_some_scenes_are_held_once_nobody_else_does(forget):
    gone = weakref.ref(first := spring(quartic=1.5))
    first_alike(first)
    del first
    gc.collect()
    assert gone() is not None
    for k in range(alike.MOST):
        first_alike(spring(quartic=2.0 + k))
    gc.collect()
    assert gone() is None and len(alike._SEEN) == alike.MOST
