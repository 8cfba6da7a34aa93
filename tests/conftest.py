"""Figures are never shown while testing."""

import matplotlib

matplotlib.use("Agg")
