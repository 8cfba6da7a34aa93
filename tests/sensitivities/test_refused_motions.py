"""What is no motion is refused in words wherever a motion is asked for."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint import multibody, orbits


def falling():
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1])


VERBS = {
    "sensitivity": vi.sensitivity,
    "gradient": lambda x: vi.gradient(x, terminal_loss=ca.SX.sym("x")),
    "event_sensitivity": vi.event_sensitivity,
    "action_derivatives": vi.action_derivatives,
    "frequencies": lambda x: orbits.frequencies(x, ca.SX.sym("x")),
    "elements": orbits.osculating_elements,
    "lyapunov_spectrum": lambda x: orbits.lyapunov_spectrum(x),
    "film": lambda x: multibody.animate(multibody.Model(), x),
}


@pytest.mark.parametrize("verb", VERBS)
def test_what_is_no_motion_is_refused_in_words(verb):
    scene = falling()
    motion = vi.simulate(scene, q0=[0, 0], v0=[1, 2], h=0.1, steps=3)
    many = vi.ensemble(scene, q0=np.zeros((2, 2)), v0=[1, 1], h=0.1, steps=3)
    for given in (3, None, "a", scene, motion.q, motion[1], [motion], many):
        with pytest.raises(vi.InputError, match=rf"wanted, got {type(given).__name__}; of an ens"):
            VERBS[verb](given)


def test_what_a_run_is_varied_by_is_a_list():
    motion = vi.simulate(falling(), q0=[0, 0], v0=[1, 2], h=0.1, steps=3)
    for call in (vi.sensitivity, lambda x, wrt: vi.event_sensitivity(x, wrt=wrt)):
        with pytest.raises(vi.InputError, match="wrt must be a list of names or symbols, got 3"):
            call(motion, 3)
