"""Films and pages of machines: surfaces where the bodies are, and a page that plays by itself."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from PIL import Image, ImageSequence

import varint as vi
import varint.multibody as mb
from varint.drawing.surfaces import outward_normals, primitive

CHROME = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")
PENDULUM = """<mujoco model="pendulum"><worldbody><body name="&lt;/script>">
  <joint name="x" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size="0.05"/>
  <geom type="box" pos="0 0 -1" size="0.1 0.15 0.2" rgba="0.9 0.2 0.1 1"/>
  <site name="tip" pos="0 0 -1.2"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def swing():
    model = mb.from_mjcf(PENDULUM)
    return model, vi.simulate(model.system(), q0=[1.2], v0=[0.0], h=0.02, steps=50)


SIZES = {
    "sphere": ((0.3,), 4 / 3 * np.pi * 0.3**3),
    "ellipsoid": ((0.1, 0.2, 0.3), 4 / 3 * np.pi * 0.006),
    "box": ((0.1, 0.2, 0.3), 0.048),
    "cylinder": ((0.1, 0.3), np.pi * 0.006),
    "capsule": ((0.1, 0.3), np.pi * (0.006 + 4 / 3 * 0.001)),
}


@pytest.mark.parametrize("kind", SIZES)
def test_a_drawn_primitive_is_closed_turned_outwards_and_encloses_its_volume(kind):
    size, volume = SIZES[kind]
    drawn = primitive(kind, size)
    corners = drawn.vertices[drawn.faces]
    enclosed = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 0.9 * volume < enclosed <= volume * (1 + 1e-12)
    # the vector areas of a closed surface cancel
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.abs(areas.sum(axis=0)).max() < 1e-12
    normals = outward_normals(corners)
    assert (np.einsum("fi,fi->f", normals, corners.mean(axis=1)) > 0).all()


def test_a_film_shows_bodies_that_move(swing, tmp_path):
    model, motion = swing
    file = tmp_path / "swing.gif"
    mb.animate(model, motion, file, fps=4, traces=["tip"], frames=["tip"])
    with Image.open(file) as film:
        pictures = [np.asarray(x.convert("RGB"), int) for x in ImageSequence.Iterator(film)]
    assert len(pictures) == 5
    red = [np.argwhere((x[..., 0] > 1.8 * x[..., 1]) & (x[..., 2] < 90)) for x in pictures]
    assert all(len(found) > 50 for found in red)  # the box
    middles = np.array([found.mean(axis=0) for found in red])
    assert np.abs(np.diff(middles, axis=0)).sum() > 20  # pixels


def test_bodies_without_shapes_are_rods(tmp_path):
    world = mb.Model()
    rod = world.body(1.0, com=(0, 0, -0.5), inertia=0.1, name="rod")
    world.revolute(world, rod, axis=(0, 1, 0), name="hinge")
    motion = vi.simulate(world.system(), q0=[1.0], v0=[0.0], h=0.02, steps=5)
    film = mb.animate(world, motion, fps=10)
    [skin] = film._fig.axes[0].collections
    assert len(skin.get_paths()) > 20


def test_what_cannot_be_drawn_is_refused(swing, tmp_path):
    model, motion = swing
    other = vi.models.pendulum()
    with pytest.raises(vi.InputError, match="give the motion of"):
        mb.animate(model, vi.simulate(other.system, q0=1.0, v0=0.0, h=0.1, steps=2))
    with pytest.raises(vi.InputError, match="unknown frame 'hand'"):
        mb.animate(model, motion, traces=["hand"])
    pytest.importorskip("plotly")
    with pytest.raises(vi.InputError, match=r"ends in \.html"):
        mb.page(model, motion, tmp_path / "swing.gif")


def test_a_page_holds_all_that_it_needs_and_no_name_ends_its_script(swing, tmp_path):
    pytest.importorskip("plotly")
    model, motion = swing
    file = tmp_path / "swing.html"
    mb.page(model, motion, file, traces=["tip"], title="<b>")
    text = file.read_text(encoding="utf-8")
    assert (
        "<title>&lt;b&gt;</title>" in text and "src=" not in text.rpartition("</script>")[0][:200]
    )
    own = text[text.rindex("<script>") :]
    assert own.count("</script>") == 1
    scene = json.loads(own.split("const scene = ")[1].split(";\n")[0])
    assert [body["name"] for body in scene["bodies"]] == ["</script>"] * 2
    assert len(scene["times"]) == 26
    assert scene["traces"][0]["points"][0] == pytest.approx(
        [-1.2 * np.sin(1.2), 0, -1.2 * np.cos(1.2)], abs=1e-5
    )


@pytest.mark.long
@pytest.mark.parametrize("width", [1400, 420])
def test_in_a_browser_the_page_plays_stops_and_turns(swing, tmp_path, width):
    pytest.importorskip("plotly")
    pytest.importorskip("playwright")
    from playwright.sync_api import Error, sync_playwright

    file = tmp_path / "swing.html"
    mb.page(*swing, file, traces=["tip"], frames=["tip"])
    with sync_playwright() as play:
        try:
            browser = play.chromium.launch(
                executable_path=CHROME, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
            )
        except Error as error:
            pytest.skip(f"no browser: {error}")
        page, said = browser.new_page(viewport=dict(width=width, height=800)), []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        asked = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        clock = page.locator("#clock")
        page.wait_for_function("document.getElementById('clock').textContent.includes('t = 0.0')")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        corners = "document.getElementById('view').data[1].x.slice(0, 8)"
        before = page.evaluate(corners)
        page.locator("#play").click()
        page.wait_for_timeout(2500)
        assert clock.inner_text() != "t = 0.00" and page.evaluate(corners) != before
        page.locator("#slider").evaluate(
            "x => { x.value = 10; x.dispatchEvent(new Event('input')); }"
        )
        page.wait_for_timeout(500)
        assert clock.inner_text() == "t = 0.40"
        spot = swing[1].at(0.4).q[0]
        found = page.evaluate("document.getElementById('view').data.at(-1)")
        assert found["x"][-1] == pytest.approx(-1.2 * np.sin(spot), abs=1e-5)
        camera = "JSON.stringify(document.getElementById('view')._fullLayout.scene.camera.eye)"
        eye = page.evaluate(camera)
        page.mouse.move(width / 2, 300)
        page.mouse.down()
        page.mouse.move(width / 2 + 80, 340, steps=5)
        page.mouse.up()
        page.wait_for_timeout(300)
        assert page.evaluate(camera) != eye
        assert asked == [file.as_uri()] and not said
        page.screenshot(path=str(tmp_path / "page.png"))
        browser.close()
