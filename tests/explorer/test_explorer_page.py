"""The explorer's page: its widgets in Python, and the page itself in a browser."""

from __future__ import annotations

import importlib.util
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

import varint as vi
from varint.__main__ import main
from varint.explorer.page import page_of
from varint.explorer.scene import motion_of, scene_of

WITHOUT = importlib.util.find_spec("panel") is None
needs_panel = pytest.mark.skipif(WITHOUT, reason="needs panel")
CHROME = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")


def turn(page, name: str, value: float) -> None:
    """What letting go of a slider does."""
    import param

    slider = page.knobs[name]
    slider.value = value
    with param.edit_constant(slider):
        slider.value_throttled = value


@needs_panel
def test_a_slider_that_is_let_go_makes_the_motion_anew():
    scene = scene_of(vi.models.double_pendulum())
    page = page_of(scene)
    before = page.sources["energy"].data["energy"]
    assert not page.note.visible
    page.player.value = 30
    turn(page, "g", 4.0)
    assert page.player.value == 0
    motion = motion_of(scene, dict(g=4.0))
    shown = page.sources["momenta"].data
    assert shown["p1"][-1] == pytest.approx(motion.p[-1, 1])
    assert np.abs(page.sources["energy"].data["energy"] - before).max() > 0
    assert f"{motion.energy[0]:.6g}" in page.numbers.object
    page.reset.clicks += 1
    assert page.knobs["g"].value == 9.81
    assert np.array_equal(page.sources["energy"].data["energy"], before)


@needs_panel
def test_the_player_s_frame_is_what_is_drawn():
    scene = scene_of(vi.models.double_pendulum())
    page = page_of(scene)
    page.player.value = 50
    at = motion_of(scene, {}).at(50 * 0.04)
    first, second = at.q
    x = [0.0, np.sin(first), np.sin(first) + np.sin(second)]
    y = [0.0, -np.cos(first), -np.cos(first) - np.cos(second)]
    dots = page.sources["dots"].data
    assert dots["x"] == pytest.approx(x, abs=1e-9)
    assert dots["y"] == pytest.approx(y, abs=1e-9)
    assert page.sources["rods"].data["x"] == [
        pytest.approx(x[:2], abs=1e-9),
        pytest.approx(x[1:], abs=1e-9),
    ]
    assert page.sources["now"].data["t"] == [2.0]
    assert page.sources["now"].data["p0"] == [pytest.approx(at.p[0])]
    assert "= 2.00" in page.numbers.object


@needs_panel
def test_what_cannot_be_simulated_is_said_on_the_page_and_the_last_motion_stays():
    page = page_of(scene_of(vi.models.pendulum_cartesian()))
    before = page.sources["momenta"].data
    turn(page, "duration", 1e9)
    assert page.note.visible
    assert "too many" in page.note.object
    assert page.sources["momenta"].data is before
    turn(page, "duration", 2.0)
    assert not page.note.visible


@needs_panel
def test_a_scene_without_a_place_has_curves_alone_and_a_notebook_gets_the_page():
    import panel

    assert scene_of(vi.models.lotka_volterra()).sketch is None
    page = page_of(scene_of(vi.models.lotka_volterra()))
    page.player.value = 3
    assert page.sources["dots"].data == {}
    assert len(page.sources["energy"].data["t"]) > 100
    assert isinstance(vi.play(vi.models.pendulum()), panel.FlexBox)


@pytest.mark.skipif(not WITHOUT, reason="panel is installed")
def test_without_panel_the_remedy_is_said(capsys):
    with pytest.raises(vi.VarintError, match=r"pip install varint-mechanics\[play\]"):
        vi.play(vi.models.pendulum())
    assert main(["play", "pendulum"]) == 2
    assert "needs the package panel" in capsys.readouterr().err


def test_the_command_refuses_what_it_cannot_play(capsys):
    assert main(["play", "rest_to_rest"]) == 2
    assert "optimal control problem" in capsys.readouterr().err
    assert main(["play", "pendulum", "--start", "psi=1"]) == 2
    assert "is no start of pendulum" in capsys.readouterr().err


@pytest.fixture
def address():
    """A page served by the command, where there is a browser to look at it."""
    pytest.importorskip("panel")
    pytest.importorskip("playwright")
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    words = ["play", "double_pendulum", "--no-browser", "--port", str(port), "--duration", "6"]
    served = subprocess.Popen([sys.executable, "-m", "varint", *words])
    where, patience = f"http://localhost:{port}", time.monotonic() + 60
    try:
        while time.monotonic() < patience:
            try:
                urllib.request.urlopen(where).read()
                break
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.2)
        yield where
    finally:
        served.terminate()
        served.wait(10)


@pytest.mark.long
@needs_panel
@pytest.mark.parametrize("width", [1400, 420])
def test_in_a_browser_the_film_plays_and_stops_and_a_slider_changes_it(address, width):
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as play:
        try:
            browser = play.chromium.launch(executable_path=CHROME, args=["--no-sandbox"])
        except Error as error:
            pytest.skip(f"no browser: {error}")
        page, said = browser.new_page(viewport=dict(width=width, height=900)), []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        page.goto(address)
        clock = page.locator("p", has_text="E =")
        clock.wait_for(timeout=30_000)
        assert "t = 0.00" in clock.inner_text()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("canvas").count() >= 3
        energy = clock.inner_text().split("E = ")[1].split()[0]
        page.locator("button.play").click()
        page.wait_for_timeout(1500)
        page.locator("button.pause").click()
        page.wait_for_timeout(500)
        now = clock.inner_text()
        assert "t = 0.00" not in now
        page.wait_for_timeout(500)
        assert clock.inner_text() == now
        assert clock.inner_text().split("E = ")[1].split()[0][:6] == energy[:6]
        field = page.locator("input[type=text]").first  # of m[0]
        field.fill("2")
        field.press("Enter")
        page.wait_for_timeout(1500)
        assert clock.inner_text().split("E = ")[1].split()[0] != energy
        assert "t = 0.00" in clock.inner_text()
        browser.close()
        assert not said
