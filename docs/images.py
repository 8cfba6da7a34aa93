"""Draw the pictures of the README and the documentation: `python docs/images.py` writes docs/images/*.png."""

from __future__ import annotations

from pathlib import Path

import casadi as ca

import varint as vi

IMAGES = Path(__file__).resolve().parent / "images"


def pendulum() -> vi.Trajectory:
    """The README's six lines."""
    q, v = vi.coordinates("theta")
    scene = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q))
    return vi.simulate(scene, q0=1.0, v0=0.0, h=0.01, steps=1000)


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    pendulum().plot().savefig(IMAGES / "pendulum.png", dpi=100)
