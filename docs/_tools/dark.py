"""Figures for pages: greys turned round for dark ones, colours lifted where they would sink, few
colours in the file.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

PAPER, INK = 0x13 / 255, 0.87  # of furo's dark pages, and the brightest grey upon it
NEUTRAL = 0.06  # channels that differ by less are a grey
FAINTEST = 0.22  # relative luminance below which a colour is lifted
WEIGHTS = np.array([0.2126, 0.7152, 0.0722])  # of red, green and blue in luminance
PROPERTIES = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")


def dark_colours(colours: np.ndarray) -> np.ndarray:
    """RGBA (…, 4) upon a dark page: white becomes its paper and black its ink; other colours keep
    their hue.
    """
    colours = np.array(colours, dtype=float)
    rgb = colours[..., :3]
    grey = np.ptp(rgb, axis=-1, keepdims=True) < NEUTRAL
    turned = INK + (PAPER - INK) * rgb
    luminance = (rgb @ WEIGHTS)[..., None]
    share = np.clip((FAINTEST - luminance) / np.maximum(1 - luminance, 1e-9), 0, 1)
    colours[..., :3] = np.where(grey, turned, rgb + share * (1 - rgb))
    return colours


def darken(figure: Any) -> None:
    """Recolour all that a figure holds, pictures and colour maps excepted."""
    from matplotlib.axes import Axes
    from matplotlib.collections import Collection
    from matplotlib.figure import FigureBase

    # those hand on to patches, which are found by themselves
    artists = [x for x in figure.findobj() if not isinstance(x, (Axes, FigureBase))]
    changes = [change for artist in artists for change in _changes(artist, Collection)]
    for put, colours in changes:  # after all were read: colours of markers may follow their line's
        put(colours)


def _changes(artist: Any, collections: type) -> Iterator[tuple[Callable, Any]]:
    """(setter, new colour) of every colour of an artist."""
    from matplotlib.colors import to_rgba_array

    many = isinstance(artist, collections)
    for name in PROPERTIES:
        get, put = getattr(artist, f"get_{name}", None), getattr(artist, f"set_{name}", None)
        if get is None or put is None or (many and artist.get_array() is not None):
            continue
        value = get()
        if isinstance(value, str) and value in ("none", "auto", "face"):
            continue
        colours = dark_colours(to_rgba_array(value))
        if len(colours):
            yield put, colours if many else tuple(colours[0])


def few_colours(png: bytes) -> bytes:
    """A PNG with a palette: a third of the size, and the eye sees no difference."""
    from PIL import Image

    small = io.BytesIO()
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture = picture.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    picture.save(small, format="PNG", optimize=True)
    return small.getvalue()
