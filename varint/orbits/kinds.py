"""The results of this floor that files hold, by the names of their classes."""

from __future__ import annotations

from varint.orbits.elements import Elements
from varint.orbits.encounters import Encounters
from varint.orbits.frequency import Frequencies
from varint.orbits.frequency_map import FrequencyMap
from varint.orbits.indicators import Alignment, Megno
from varint.orbits.lyapunov import LyapunovSpectrum
from varint.orbits.section import Section

KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        Alignment,
        Elements,
        Encounters,
        Frequencies,
        FrequencyMap,
        LyapunovSpectrum,
        Megno,
        Section,
    )
}
