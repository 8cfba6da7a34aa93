"""All exercises of the course by lesson and number."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from varint.course import motions, principles
from varint.course.exercise import Exercise

exercises: Mapping[str, Exercise] = MappingProxyType(
    {
        "1.1": Exercise(
            "A System: a mass of 0.5 kg hangs on a spring of 40 N/m; x downward from where the "
            "spring is relaxed, g = 9.81 m/s².",
            principles.hanging_mass,
        ),
        "1.2": Exercise(
            "The longest duration for which the paths of L = ẋ²/2 − 9 x²/2 make the action a "
            "minimum.",
            principles.longest_minimum,
        ),
        "2.1": Exercise(
            "A System with the one coordinate x: a bead of mass 1 on the wire y = x²/2, "
            "g = 9.81 downward.",
            principles.bead_on_parabola,
        ),
        "2.2": Exercise(
            "A function s → (foot, top): where a ladder of length 2 stands on the floor and leans "
            "on the wall, for 0.2 < s < 1.2, by a coordinate s of your choice.",
            principles.ends_of_ladder,
        ),
        "3.1": Exercise(
            "A function (q, v) → quantity that L = |v|²/2 + (x ẏ − y ẋ) conserves, and that is "
            "not the energy.",
            principles.charge_in_field,
        ),
        "3.2": Exercise(
            "The numbers (ξ_φ, ξ_z) of a symmetry of L = (φ̇² + ż²)/2 − cos(3 φ − 2 z).",
            principles.screw,
        ),
        "4.1": Exercise(
            "The largest tension, in N, of the rod of a pendulum of 0.2 kg and 1 m let go at the "
            "horizontal, g = 9.81.",
            principles.largest_tension,
        ),
        "4.2": Exercise(
            "A System in x and y: a bead of mass 1 on the wire y = x²/2, which is a constraint; "
            "g = 9.81.",
            principles.bead_as_constraint,
        ),
        "5.1": Exercise(
            "The two frequencies, in 1/s, of small swings of a double pendulum, m = ℓ = 1, "
            "g = 9.81.",
            motions.double_pendulum_frequencies,
        ),
        "5.2": Exercise(
            "The coupling k_c with which L = (ẋ₁² + ẋ₂²)/2 − 2 (x₁² + x₂²) − k_c (x₁ − x₂)²/2 "
            "hands all motion from one mass to the other in 20 s.",
            motions.coupling,
        ),
        "6.1": Exercise(
            "The speed on the circle r = 2 in the potential r⁴/4, m = 1.", motions.circular_speed
        ),
        "6.2": Exercise(
            "The n > 0 for which nearly circular orbits in the potential rⁿ have their nearest "
            "points 120° apart.",
            motions.power,
        ),
        "7.1": Exercise(
            "A function (q, p, h) → (q, p): one symplectic step, of any order, of the pendulum "
            "H = p²/2 − cos q.",
            motions.symplectic_step,
        ),
        "7.2": Exercise(
            "A function (q, p) → P that makes Q = √(2q) cos p and P canonical.",
            motions.canonical_momentum,
        ),
        "8.1": Exercise(
            "A function ω → dω/dt (three components along the body's axes) of a free body with "
            "the moments of inertia 1, 2, 3.",
            motions.euler_equations,
        ),
        "8.2": Exercise(
            "The rate of steady precession φ̇ > 5, in 1/s, of the top I₁ = 1, I₃ = 0.5, m g ℓ = 2 "
            "that leans by θ = 1 and has the momentum p_ψ = 5 about its axis.",
            motions.steady_precession,
        ),
    }
)
