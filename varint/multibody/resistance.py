"""How springs and dampers resist: what a matrix near the derivative of a step's equations needs to
know of them.
"""

from __future__ import annotations

import casadi as ca

from varint.multibody.data import Machine
from varint.multibody.forces import gap_between, is_zero, joint_dissipation
from varint.multibody.frames import fixed_frames
from varint.multibody.kinematics import Motions
from varint.multibody.tree import Tree


def stiffness_and_damping(machine: Machine, tree: Tree, motions: Motions) -> dict[str, ca.SX]:
    """`stiffness` and `damping` of `Kinetics`: exact for joints, and of springs between frames
    ``k JᵀJ`` with the derivative J of what they resist; the drag of a medium is left out.
    """
    q, v, n = machine.q, machine.v, machine.q.numel()
    springs = [x for x in machine.springs.values() if not (is_zero(x.stiffness + x.damping))]
    ends = fixed_frames(tree, motions, [end for x in springs for end in (x.a, x.b)])
    stretched = ca.SX(0)
    for joint in machine.joints.values():
        if not is_zero(joint.passive.stiffness):
            off = motions[joint.name][0] - joint.passive.rest
            stretched += joint.passive.stiffness * ca.sumsqr(off) / 2
    stiffness = ca.sparsify(ca.hessian(stretched, q)[0])
    damping = ca.sparsify(ca.hessian(joint_dissipation(machine, motions), v)[0])
    for spring, a, b in zip(springs, ends[::2], ends[1::2], strict=True):
        gap = gap_between(a, b)
        every = ca.jacobian(gap, q)
        along = ca.mtimes(gap.T, every) / ca.norm_2(gap)
        free = is_zero(spring.rest)
        stiffness += (
            spring.stiffness * ca.mtimes(every.T, every)
            if free
            else (spring.stiffness * ca.mtimes(along.T, along))
        )
        if not is_zero(spring.damping):
            damping += spring.damping * ca.mtimes(along.T, along)
    none = ca.SX(0, 0)
    return {
        "stiffness": ca.SX(stiffness) if stiffness.nnz() and n else none,
        "damping": ca.SX(damping) if damping.nnz() and n else none,
    }
