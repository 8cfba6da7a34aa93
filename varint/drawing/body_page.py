"""A page that plays rigid bodies, to be turned and zoomed: the only place that imports plotly, and
only when a page is wanted.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from varint.drawing.animation import extent
from varint.drawing.style import COLOURS
from varint.drawing.surfaces import MovingBody, box_corners
from varint.errors import InputError
from varint.numerics.files import write_atomically

DIGITS = 6  # of places and corners: a millionth of the picture
MOST_NUMBERS = 4_000_000  # of all corners and places: a page of some 40 MB
AXES = ("#D55E00", "#009E73", "#0072B2")  # of a frame: x, y, z


def write_body_page(
    bodies: Sequence[MovingBody],
    frames: Mapping[str, tuple[np.ndarray, np.ndarray]],
    traces: Mapping[str, np.ndarray],
    times: np.ndarray,
    *,
    arm: float,
    fps: float,
    path: Any,
    title: str,
) -> None:
    """Write the page; parameters as in `body_film`. Bodies are sent once and moved in the browser.

    Raises
    ------
    InputError
        If plotly is not installed, the name does not end in .html, or the page would be too large.
    """
    target = Path(path)
    if target.suffix.lower() != ".html":
        raise InputError(f"{target} is no page: give a name that ends in .html")
    if importlib.util.find_spec("plotly") is None:
        raise InputError("a page needs plotly; pip install 'varint-mechanics[view]'")
    import plotly.offline

    numbers = sum(x.surface.vertices.size + 12 * len(times) for x in bodies)
    numbers += 12 * len(times) * len(frames) + 3 * len(times) * len(traces)
    if numbers > MOST_NUMBERS:
        raise InputError(
            f"the page would hold {numbers} numbers (limit {MOST_NUMBERS}); raise speed= or lower "
            "fps="
        )
    middle, half = extent([box_corners(body) for body in bodies])
    scene = {
        "bodies": [
            {
                "name": body.name,
                "vertices": _rounded(body.surface.vertices, half),
                "faces": body.surface.faces.tolist(),
                "colour": _css(body.colour),
                "opacity": body.colour[3],
                "positions": _rounded(body.positions, half),
                "rotations": _rounded(body.rotations.reshape(-1, 9), 1.0),
            }
            for body in bodies
        ],
        "frames": [
            {
                "name": name,
                "positions": _rounded(positions, half),
                "rotations": _rounded(rotations.reshape(-1, 9), 1.0),
            }
            for name, (positions, rotations) in frames.items()
        ],
        "traces": [
            {"name": name, "points": _rounded(points, half), "colour": COLOURS[k % len(COLOURS)]}
            for k, (name, points) in enumerate(traces.items())
        ],
        "times": times.tolist(),
        "low": (middle - half).tolist(),
        "high": (middle + half).tolist(),
        "arm": arm,
        "fps": fps,
        "axes": AXES,
    }
    # no "</script>" in a name may end the script
    data = json.dumps(scene, allow_nan=False).replace("<", "\\u003c")
    page = PAGE.replace("%TITLE%", escape(title or "A machine in motion"))
    page = page.replace("%LIBRARY%", plotly.offline.get_plotlyjs()).replace("%SCENE%", data)
    write_atomically(target, lambda file: file.write(page.encode()))


def _rounded(values: np.ndarray, size: float) -> list:
    digits = max(0, DIGITS - int(np.floor(np.log10(size))))
    return np.round(values, digits).tolist()


def _css(colour: Sequence[float]) -> str:
    red, green, blue = (round(255 * min(max(x, 0.0), 1.0)) for x in colour[:3])
    return f"rgb({red},{green},{blue})"


PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>%TITLE%</title>
<style>
html, body { margin: 0; height: 100%; font-family: sans-serif; background: #fff; color: #222; }
main { display: flex; flex-direction: column; height: 100%; }
#view { flex: 1; min-height: 0; }
nav { display: flex; gap: 0.8em; align-items: center; padding: 0.6em 1em; }
nav button { font-size: 1em; padding: 0.3em 0.9em; }
#slider { flex: 1; min-width: 5em; }
#clock { min-width: 6em; font-variant-numeric: tabular-nums; }
</style>
<script>%LIBRARY%</script>
</head>
<body>
<main>
<div id="view"></div>
<nav>
<button id="play" aria-label="play or stop">play</button>
<input id="slider" type="range" min="0" value="0" step="1" aria-label="time">
<span id="clock"></span>
</nav>
</main>
<script>
"use strict";
const scene = %SCENE%;
const view = document.getElementById("view"), slider = document.getElementById("slider");
const button = document.getElementById("play"), clock = document.getElementById("clock");
const last = scene.times.length - 1;
const gap = last > 0 ? Math.abs(scene.times[1] - scene.times[0]) : 1;
const decimals = Math.max(0, 1 + Math.floor(-Math.log10(gap)));

// the corners of a body in space: x = p + R c
function moved(body, k) {
  const p = body.positions[k], r = body.rotations[k], x = [], y = [], z = [];
  for (const c of body.vertices) {
    x.push(p[0] + r[0] * c[0] + r[1] * c[1] + r[2] * c[2]);
    y.push(p[1] + r[3] * c[0] + r[4] * c[1] + r[5] * c[2]);
    z.push(p[2] + r[6] * c[0] + r[7] * c[1] + r[8] * c[2]);
  }
  return [x, y, z];
}
function arms(frame, k, axis) {
  const p = frame.positions[k], r = frame.rotations[k];
  return [0, 1, 2].map(i => [p[i], p[i] + scene.arm * r[3 * i + axis]]);
}
function way(trace, k) {
  const points = trace.points.slice(0, k + 1);
  return [0, 1, 2].map(i => points.map(p => p[i]));
}
// what is drawn, and where it is in frame k
const parts = [], places = [];
for (const body of scene.bodies) {
  const [i, j, k] = [0, 1, 2].map(n => body.faces.map(face => face[n]));
  parts.push({type: "mesh3d", i, j, k, color: body.colour, opacity: body.opacity,
    flatshading: true, name: body.name, hoverinfo: "name",
    lighting: {ambient: 0.55, diffuse: 0.7, specular: 0.15, roughness: 0.8}});
  places.push(n => moved(body, n));
}
for (const frame of scene.frames) {
  for (const axis of [0, 1, 2]) {
    parts.push({type: "scatter3d", mode: "lines", line: {width: 5, color: scene.axes[axis]},
      name: frame.name, hoverinfo: "name"});
    places.push(n => arms(frame, n, axis));
  }
}
for (const trace of scene.traces) {
  parts.push({type: "scatter3d", mode: "lines", line: {width: 3, color: trace.colour},
    name: trace.name, hoverinfo: "name"});
  places.push(n => way(trace, n));
}
parts.forEach((part, n) => { [part.x, part.y, part.z] = places[n](0); });
const side = (name, n) => ({title: {text: name}, range: [scene.low[n], scene.high[n]],
  autorange: false, backgroundcolor: "#f6f6f6", showbackground: true});
const far = window.innerWidth < 700 ? 1.7 : 1;  // all of it on a narrow screen
const layout = {margin: {l: 0, r: 0, t: 0, b: 0}, showlegend: false, uirevision: 1,
  scene: {aspectmode: "cube", xaxis: side("x", 0), yaxis: side("y", 1), zaxis: side("z", 2),
    camera: {eye: {x: 1.3 * far, y: -1.5 * far, z: 0.8 * far}}}};
let now = 0, playing = false, since = 0, from = 0, busy = false;
slider.max = last;
function show(k) {
  now = k;
  slider.value = k;
  clock.textContent = "t = " + scene.times[k].toFixed(decimals);
  const at = places.map(place => place(k));
  busy = true;
  return Plotly.restyle(view, {x: at.map(p => p[0]), y: at.map(p => p[1]),
    z: at.map(p => p[2])}).then(() => { busy = false; });
}
function stop() { playing = false; button.textContent = "play"; }
function step(stamp) {
  if (!playing) return;
  if (!since) { since = stamp; from = now; }
  const k = from + Math.floor((stamp - since) / 1000 * scene.fps);
  if (k >= last) { show(last); stop(); return; }
  if (k !== now && !busy) show(k);
  requestAnimationFrame(step);
}
button.addEventListener("click", () => {
  if (playing) { stop(); return; }
  if (now >= last) now = 0;
  playing = true; since = 0; button.textContent = "stop";
  requestAnimationFrame(step);
});
slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
Plotly.newPlot(view, parts, layout, {responsive: true, displaylogo: false}).then(() => show(0));
</script>
</body>
</html>
"""
