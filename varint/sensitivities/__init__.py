"""Derivatives of whole runs: tangents, adjoints."""
