"""What one does with a scene and its motions after simulating: equilibria and modes, periodic
orbits and their families, stability, sections, chaos, frequencies, orbital elements.
"""

from varint.orbits.bifurcations import Bifurcation
from varint.orbits.elements import Elements, jacobi_elements, osculating_elements
from varint.orbits.encounters import Encounters, encounters
from varint.orbits.energy_starts import starts_at_energy
from varint.orbits.equilibria import Equilibria, equilibria
from varint.orbits.family import Family
from varint.orbits.floquet import floquet
from varint.orbits.follow import family
from varint.orbits.frequency import Frequencies, frequencies, naff
from varint.orbits.frequency_map import (
    FrequencyMap,
    frequency_map,
    resonance,
    resonance_name,
)
from varint.orbits.indicators import Alignment, Megno, gali, megno, sali
from varint.orbits.kepler import KeplerElements, kepler_elements, kepler_state
from varint.orbits.lyapunov import LyapunovSpectrum, lyapunov_spectrum
from varint.orbits.modes import NormalModes, normal_modes
from varint.orbits.multipliers import Floquet
from varint.orbits.orbit import Orbit
from varint.orbits.pairs import approaches, collisions
from varint.orbits.periodic import periodic
from varint.orbits.relative import corotating, relative_equilibria
from varint.orbits.rest import Equilibrium
from varint.orbits.section import Section, poincare_section
from varint.orbits.tangent_lift import tangent_lift

__all__ = [
    "Alignment",
    "Bifurcation",
    "Elements",
    "Encounters",
    "Equilibria",
    "Equilibrium",
    "Family",
    "Floquet",
    "Frequencies",
    "FrequencyMap",
    "KeplerElements",
    "LyapunovSpectrum",
    "Megno",
    "NormalModes",
    "Orbit",
    "Section",
    "approaches",
    "collisions",
    "corotating",
    "encounters",
    "equilibria",
    "family",
    "floquet",
    "frequencies",
    "frequency_map",
    "gali",
    "jacobi_elements",
    "kepler_elements",
    "kepler_state",
    "lyapunov_spectrum",
    "megno",
    "naff",
    "normal_modes",
    "osculating_elements",
    "periodic",
    "poincare_section",
    "relative_equilibria",
    "resonance",
    "resonance_name",
    "sali",
    "starts_at_energy",
    "tangent_lift",
]
