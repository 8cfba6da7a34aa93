"""Sphinx configuration: Markdown by MyST, furo, every Python block executed, some pages
measured.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_tools")]

import varint  # noqa: E402  (only findable now)

project = "varint"
author = "the varint authors"
copyright = "2026, the varint authors"
release = version = varint.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "alternatives",
    "formulas",
    "docstrings",
    "executed",
    "fitted",
    "generated",
    "notebooks",
]
myst_enable_extensions = ["amsmath", "attrs_inline", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "_tools", "images.py", "known_limits.md"]
html_theme = "furo"
html_title = "varint"
html_static_path = ["_static"]
html_css_files = ["varint.css"]
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0072B2", "color-brand-content": "#0072B2"},
    "dark_css_variables": {"color-brand-primary": "#56B4E9", "color-brand-content": "#56B4E9"},
}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
nitpicky = False  # types in docstrings are words: "SX (n,)"
default_role = "py:obj"
suppress_warnings = ["ref.python"]  # "steps" in a shape such as (steps, k) is no reference
linkcheck_ignore = [
    r"\.\./_images/.*"
]  # the gallery's pictures in full size, which the HTML builder puts there
linkcheck_timeout = 15
linkcheck_retries = 2
linkcheck_workers = 4
