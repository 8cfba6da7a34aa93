"""What one does with a motion after simulating it: chaos, sections, frequencies, orbital
elements.
"""

from varint.orbits.elements import Elements, jacobi_elements, osculating_elements
from varint.orbits.encounters import Encounters, approaches, collisions, encounters
from varint.orbits.energy_starts import starts_at_energy
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
from varint.orbits.section import Section, poincare_section
from varint.orbits.tangent_lift import tangent_lift

__all__ = [
    "Alignment",
    "Elements",
    "Encounters",
    "Frequencies",
    "FrequencyMap",
    "KeplerElements",
    "LyapunovSpectrum",
    "Megno",
    "Section",
    "approaches",
    "collisions",
    "encounters",
    "frequencies",
    "frequency_map",
    "gali",
    "jacobi_elements",
    "kepler_elements",
    "kepler_state",
    "lyapunov_spectrum",
    "megno",
    "naff",
    "osculating_elements",
    "poincare_section",
    "resonance",
    "resonance_name",
    "sali",
    "starts_at_energy",
    "tangent_lift",
]
