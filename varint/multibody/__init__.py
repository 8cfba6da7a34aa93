"""Machines and robots: bodies, joints and loops make a `System`, nobody writes the Lagrangian.

``import varint.multibody as mb``; `Model` builds a machine, ``model.system()`` is its scene, and
``model.frame(name)`` gives places and velocities as expressions for costs, constraints and plots.
"""

from varint.multibody.attitude import rotation_covariance
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
    Medium,
    Passive,
    Placement,
    Spring,
)
from varint.multibody.frames import Frame
from varint.multibody.functions import Dynamics
from varint.multibody.mjcf import from_mjcf
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
from varint.multibody.shapes import Shape
from varint.multibody.start import start_values
from varint.multibody.urdf import from_urdf
from varint.multibody.view import animate, page, skeleton

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
    "Medium",
    "Model",
    "Passive",
    "Placement",
    "Shape",
    "Spring",
    "animate",
    "axis_rotation",
    "euler_angles",
    "from_mjcf",
    "from_urdf",
    "matrix_quaternion",
    "page",
    "placed",
    "quaternion_matrix",
    "quaternion_rate",
    "roll_pitch_yaw",
    "rotation_covariance",
    "skeleton",
    "start_values",
]
