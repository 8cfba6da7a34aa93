"""The verb: play with a scene in a notebook."""

from __future__ import annotations

from typing import Any

from varint.drawing.sketch import Sketch
from varint.errors import InputError
from varint.explorer.page import page_of, panel_module
from varint.explorer.scene import scene_of
from varint.models.model import Model
from varint.results.trajectory import Trajectory


def play(what: Model | Trajectory, *, sketch: Sketch | None = None) -> Any:
    """A page to play with a scene: sliders for parameters, start and duration, a player, energy and
    momenta.

    The motion is made anew, δ∫ L dt = 0 by the scene's rule, whenever a slider is let go.

    Parameters
    ----------
    what : Model or Trajectory
        A ready model, or a motion of your own scene, from whose start, parameters, step and rule
        one sets out.
    sketch : Sketch, optional
        What is drawn. Default: the model's, or the bodies of coordinates such as x1, y1.

    Returns
    -------
    panel object
        Shown where it is the value of a notebook's cell; ``.show()`` opens a browser.

    Raises
    ------
    InputError
        If `what` is neither, or its steps differ, or its controls change with time.
    VarintError
        If Panel is not installed: ``pip install varint-mechanics[play]``.

    Notes
    -----
    ``python -m varint play double_pendulum`` does the same from a terminal. The start is brought
    onto the constraints of the scene by `project`.

    Examples
    --------
    >>> import varint as vi
    >>> page = vi.play(vi.models.double_pendulum())  # doctest: +SKIP
    """
    if sketch is not None and not isinstance(sketch, Sketch):
        raise InputError(f"sketch takes a varint.Sketch, got {type(sketch).__name__}")
    scene = scene_of(what, sketch)
    panel_module("play").extension()
    return page_of(scene).root
