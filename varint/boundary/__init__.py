"""Boundary value problems: paths of stationary action between end points."""
