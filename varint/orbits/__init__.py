"""Equilibria, periodic orbits, stability, chaos."""

__all__: list[str] = []
