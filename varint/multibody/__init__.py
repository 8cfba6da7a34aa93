"""Machines and robots: bodies, joints and loops make a `System`, nobody writes the Lagrangian.

``import varint.multibody as mb``; `Model` builds a machine, ``model.system()`` is its scene, and
``model.frame(name)`` gives places and velocities as expressions for costs, constraints and plots.
"""

from varint.multibody.data import (
    WORLD,
    Actuator,
    Anchor,
    Body,
    Coupling,
    Joint,
    Limits,
    Loop,
    Machine,
    Passive,
    Placement,
    Spring,
)
from varint.multibody.frames import Frame
from varint.multibody.functions import Dynamics
from varint.multibody.model import Model
from varint.multibody.quantities import placed
from varint.multibody.rotations import (
    axis_rotation,
    euler_angles,
    matrix_quaternion,
    quaternion_matrix,
    quaternion_rate,
    roll_pitch_yaw,
)
from varint.multibody.start import start_values

__all__ = [
    "WORLD",
    "Actuator",
    "Anchor",
    "Body",
    "Coupling",
    "Dynamics",
    "Frame",
    "Joint",
    "Limits",
    "Loop",
    "Machine",
    "Model",
    "Passive",
    "Placement",
    "Spring",
    "axis_rotation",
    "euler_angles",
    "matrix_quaternion",
    "placed",
    "quaternion_matrix",
    "quaternion_rate",
    "roll_pitch_yaw",
    "start_values",
]
