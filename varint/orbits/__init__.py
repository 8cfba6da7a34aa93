"""Equilibria, periodic orbits, stability, chaos."""

from varint.orbits.bifurcations import Bifurcation
from varint.orbits.equilibria import Equilibria, equilibria
from varint.orbits.family import Family, family
from varint.orbits.floquet import floquet
from varint.orbits.modes import NormalModes, normal_modes
from varint.orbits.multipliers import Floquet
from varint.orbits.orbit import Orbit
from varint.orbits.periodic import periodic
from varint.orbits.relative import corotating, relative_equilibria
from varint.orbits.rest import Equilibrium

__all__ = [
    "Bifurcation",
    "Equilibria",
    "Equilibrium",
    "Family",
    "Floquet",
    "NormalModes",
    "Orbit",
    "corotating",
    "equilibria",
    "family",
    "floquet",
    "normal_modes",
    "periodic",
    "relative_equilibria",
]
