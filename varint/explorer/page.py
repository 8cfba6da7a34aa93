"""The page: Panel's sliders and player, Bokeh's figures; the only place that imports either, and
only when a page is wanted.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from varint.drawing.style import COLOURS, shown_indices
from varint.errors import VarintError
from varint.explorer.film import SECONDS, Film, film_of
from varint.explorer.scene import Knob, Scene, motion_of
from varint.notation.names import plain_name

STEPS = 200  # of a slider from end to end
FEW = 8  # knobs of a group that lies open
WIDTH, TALL, LOW = 400, 400, 230  # pixels: of a column, the picture, and a curve
GREY = "#404040"
HOST = "localhost"


@dataclass(frozen=True, eq=False)
class Page:
    """What a page is made of.

    Attributes
    ----------
    root : panel object
        The page, to be shown in a notebook or served.
    knobs : dict of str to slider
        By the names of the scene's knobs.
    player : panel.widgets.Player
        Its value is the frame.
    note : panel.pane.Alert
        What could not be done, or was warned of.
    numbers : panel.pane.Markdown
        Time, energy and momenta now.
    sources : dict of str to bokeh.models.ColumnDataSource
        What the figures show: ``dots``, ``rods``, ``traces``, ``now``, ``energy``, ``momenta``.
    reset : panel.widgets.Button
        Turns everything back.
    """

    root: Any
    knobs: dict[str, Any]
    player: Any
    note: Any
    numbers: Any
    sources: dict[str, Any]
    reset: Any


def panel_module(what: str) -> Any:
    """Panel for `what` asks for it.

    Raises
    ------
    VarintError
        If it is not installed.
    """
    if find_spec("panel") is None:
        raise VarintError(f"{what} needs the package panel: pip install varint-mechanics[play]")
    import panel

    return panel


def page_of(scene: Scene) -> Page:
    """The page of a scene, with its first motion."""
    pn = panel_module("play")
    from bokeh.models import ColumnDataSource

    names = ("dots", "rods", "traces", "now", "energy", "momenta")
    sources = {name: ColumnDataSource() for name in names}
    knobs = {knob.name: _slider(pn, knob) for knob in scene.knobs}
    player = pn.widgets.Player(
        start=0,
        end=1,
        interval=int(1000 * SECONDS),
        loop_policy="loop",
        show_loop_controls=False,
        show_value=False,
        visible_buttons=["slower", "first", "previous", "pause", "play", "next", "faster"],
        width=WIDTH - 40,
    )
    note = pn.pane.Alert("", alert_type="warning", visible=False, width=WIDTH)
    numbers = pn.pane.Markdown("", width=WIDTH)
    reset = pn.widgets.Button(label="as it was", width=120)
    picture, curves = _picture(scene, sources), _curves(scene, sources)
    shown = [pn.pane.Bokeh(picture)] if picture is not None else []
    title = [f"## {scene.name}", scene.claim] if scene.name else []
    root = pn.FlexBox(
        pn.Column(*title, note, *shown, player, numbers, width=WIDTH),
        pn.Column(*_groups(pn, scene, knobs), reset, width=WIDTH),
        pn.Column(*map(pn.pane.Bokeh, curves), width=WIDTH),
        gap="16px",
    )
    page = Page(root, knobs, player, note, numbers, sources, reset)
    film: list[Film] = []  # the one that is shown

    def turn(*_: Any) -> None:
        made = _made(page, scene)
        if made is None:
            return
        film[:] = [made]
        _lay(page, scene, made, picture)
        player.param.update(end=len(made.t) - 1, value=0)
        _show(page, scene, made, 0)

    def turn_back(*_: Any) -> None:
        for knob in scene.knobs:
            knobs[knob.name].value = knob.value
        turn()

    for slider in knobs.values():
        slider.param.watch(turn, "value_throttled")
    reset.on_click(turn_back)
    player.param.watch(lambda event: _show(page, scene, film[0], event.new), "value")
    turn()
    return page


def _made(page: Page, scene: Scene) -> Film | None:
    """The film with the numbers of the sliders; None where there is no such motion, which the
    page's note says.
    """
    turned = {name: float(slider.value) for name, slider in page.knobs.items()}
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always", UserWarning)
        try:
            made, kind = film_of(scene, motion_of(scene, turned)), "warning"
        except VarintError as error:
            page.note.param.update(object=str(error), alert_type="danger", visible=True)
            return None
    words = "\n\n".join(dict.fromkeys(str(x.message) for x in warned))
    page.note.param.update(object=words, alert_type=kind, visible=bool(words))
    return made


def _slider(pn: Any, knob: Knob) -> Any:
    """A slider with a field for any number."""
    return pn.widgets.EditableFloatSlider(
        label=plain_name(knob.name),
        value=knob.value,
        start=knob.low,
        end=knob.high,
        step=(knob.high - knob.low) / STEPS,
        width=WIDTH - 60,
    )


def _groups(pn: Any, scene: Scene, knobs: dict[str, Any]) -> list[Any]:
    """A card for each kind of knob; large ones are closed."""
    cards = []
    for group in dict.fromkeys(knob.group for knob in scene.knobs):
        mine = [knobs[knob.name] for knob in scene.knobs if knob.group == group]
        card = dict(title=group, collapsed=len(mine) > FEW, width=WIDTH - 20)
        cards.append(pn.Card(*mine, **card))
    return cards


def _picture(scene: Scene, sources: dict[str, Any]) -> Any:
    """The figure of rods, traces and dots; None where nothing has a place."""
    from bokeh.models import Range1d
    from bokeh.plotting import figure

    if scene.sketch is None:
        return None
    found = figure(
        width=WIDTH,
        height=TALL,
        x_range=Range1d(-1, 1),
        y_range=Range1d(-1, 1),
        tools="pan,wheel_zoom,reset,save",
        toolbar_location="above",
    )
    found.multi_line("x", "y", source=sources["traces"], color="colour", alpha=0.6)
    found.multi_line("x", "y", source=sources["rods"], color=GREY, width=3)
    found.scatter("x", "y", source=sources["dots"], color="colour", size=11)
    found.axis.visible = scene.sketch.dimensions == 2
    return found


def _curves(scene: Scene, sources: dict[str, Any]) -> tuple[Any, Any]:
    """Energy error and momenta over time, and a dot on each that is now."""
    from bokeh.models import Legend
    from bokeh.plotting import figure

    kept = dict(width=WIDTH, height=LOW, x_axis_label="time t", tools="pan,wheel_zoom,reset")
    kept |= dict(toolbar_location="above")
    energy = figure(title="Energy, E − E(0)", **kept)
    energy.line("t", "energy", source=sources["energy"], color=COLOURS[0])
    energy.scatter("t", "energy", source=sources["now"], color=COLOURS[0], size=8)
    momenta = figure(title="Momenta p", x_range=energy.x_range, **(kept | {"height": LOW + 50}))
    names, legend = scene.system.names, []
    for colour, i in zip(COLOURS, shown_indices(len(names)), strict=False):
        line = momenta.line("t", f"p{i}", source=sources["momenta"], color=colour)
        dot = momenta.scatter("t", f"p{i}", source=sources["now"], color=colour, size=8)
        legend.append((plain_name(names[i]), [line, dot]))
    momenta.add_layout(Legend(items=legend, orientation="horizontal", click_policy="hide"), "below")
    return energy, momenta


def _lay(page: Page, scene: Scene, film: Film, picture: Any) -> None:
    """What stays the same from frame to frame."""
    page.sources["energy"].data = {"t": film.curve_t, "energy": film.energy}
    momenta = {f"p{i}": p for i, p in enumerate(film.momenta.T)}
    page.sources["momenta"].data = {"t": film.curve_t, **momenta}
    if picture is None:
        return
    for ends, centre in ((picture.x_range, film.middle[0]), (picture.y_range, film.middle[1])):
        ends.update(start=centre - film.half, end=centre + film.half)
        ends.update(reset_start=centre - film.half, reset_end=centre + film.half)


def _show(page: Page, scene: Scene, film: Film, frame: int) -> None:
    """One frame: places, the dots on the curves, and the numbers."""
    k, sketch = min(int(frame), len(film.t) - 1), scene.sketch
    energy, *p = film.at_frames[k]
    first = film.at_frames[0, 0]
    now = {f"p{i}": [x] for i, x in enumerate(p)}
    page.sources["now"].data = {"t": [film.t[k]], "energy": [energy - first], **now}
    if sketch is not None:
        colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(sketch.marks)}
        at = {name: where[k] for name, where in film.places.items()}
        x, y = np.array([at[name] for name in sketch.marks]).reshape(-1, 2).T
        page.sources["dots"].data = {"x": x, "y": y, "colour": list(colours.values())}
        page.sources["rods"].data = {
            axis: [[at[a][i], at[b][i]] for a, b in sketch.rods] for i, axis in enumerate("xy")
        }
        past = {
            axis: [film.places[name][: k + 1, i] for name in sketch.traces]
            for i, axis in enumerate("xy")
        }
        trace_colours = [colours.get(name, COLOURS[0]) for name in sketch.traces]
        page.sources["traces"].data = {**past, "colour": trace_colours}
    shown = [f"**t** = {film.t[k]:.2f}", f"**E** = {energy:.6g}"]
    shown += [
        f"**p**({plain_name(scene.system.names[i])}) = {p[i]:.4g}" for i in shown_indices(len(p))
    ]
    if film.speed != 1.0:
        shown.append(f"a second here is {film.speed:g} of the motion's time")
    page.numbers.object = " &nbsp; ".join(shown)


def serve(scene: Scene, port: int, opened: bool) -> None:
    """Serve the page, one for each visitor, until it is interrupted."""
    pn = panel_module("play")
    title = f"varint: {scene.name}" if scene.name else "varint"

    def root() -> Any:  # Panel calls functions, and shows other callables as text
        return page_of(scene).root

    # nobody else's machine may set this one to work
    pn.serve(root, port=port, address=HOST, show=opened, title=title)
