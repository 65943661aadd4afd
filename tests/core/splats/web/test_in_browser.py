"""The web page in a real browser, opened from the disk: what it draws, its controls, and where it cannot draw."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from cvdgs.core.color.spaces import delta_e_2000, image_to_tensor
from cvdgs.core.color.srgb import simulate_bytes
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import write_png
from cvdgs.core.runs.report_page import write_report_page
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import ParameterSet, RasterCamera, Rasterizer
from cvdgs.core.splats.web.finished_run import write_viewer
from cvdgs.core.splats.web.page import Still, write_web_page
from cvdgs.scripts.benchmarks.browser import WITHOUT_GRAPHICS, browser, find_browser, open_viewer, picture_of

from .scenes import CAMERA, layered, ring, surroundings, write_run

LEAST_DECIBELS = 45.0  # against the rasteriser; 8 bits a channel allow some 59
PHONE = {"width": 390, "height": 844}

try:
    find_browser()
except InputError as error:
    pytestmark = pytest.mark.skip(reason=str(error))


@pytest.fixture(scope="module")
def running() -> Iterator[Any]:
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("page") / "scene & more.html"
    write_web_page(path, layered(400, degree=3), "", surroundings())
    return path


@pytest.fixture
def page(running, path) -> Iterator[Any]:
    page = running.new_page(viewport={"width": 900, "height": 600})
    page.errors, page.asked = [], []
    page.on("pageerror", lambda error: page.errors.append(error))
    page.on("request", lambda request: page.asked.append(request.url))
    open_viewer(page, path)
    yield page
    assert page.errors == []
    page.close()


def pixels(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def shown(page: Any) -> NDArray[np.uint8]:
    """What is on the page's canvas now."""
    return pixels(page.locator("#view").screenshot())


def camera(page: Any, number: int = 1) -> dict[str, Any]:
    return page.evaluate(f"cvdgs.scene.cameras[{number}]")


def rasterised(gaussians: Gaussians, number: int) -> NDArray[np.uint8]:
    pose = np.linalg.inv(ring()[number].camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0]))
    raster_camera = RasterCamera(
        CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, pose, near=0.16
    )
    frame = Rasterizer(threads=2).render(ParameterSet.from_gaussians(gaussians), raster_camera, (0.0, 0.0, 0.0))
    return np.round(np.clip(frame.color.numpy(), 0.0, 1.0) * 255.0).astype(np.uint8)


def decibels(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    return float(10.0 * np.log10(255.0**2 / np.mean((first.astype(np.float64) - second) ** 2)))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_pictures_are_those_of_the_rasteriser(running, tmp_path, degree):
    layers = layered(400, degree)
    write_web_page(tmp_path / "scene.html", layers, "", surroundings())
    page = running.new_page()
    open_viewer(page, tmp_path / "scene.html")
    for number in (0, 1):
        for layer, gaussians in enumerate(layers.values()):
            found = pixels(picture_of(page, camera(page, number), layer=layer))
            assert decibels(found, rasterised(gaussians, number)) >= LEAST_DECIBELS, (number, layer)
    page.close()


def test_nothing_is_asked_of_any_other_computer(page, path):
    page.evaluate("fetch('https://example.org').catch(() => {})")  # and the page would not be allowed to
    assert {url.partition(":")[0] for url in page.asked} <= {"file", "blob", "data", "https"}
    assert [url for url in page.asked if url.startswith("file:")] == [path.as_uri()]
    blocked = page.evaluate("fetch('https://example.org').then(() => 'fetched', () => 'refused')")
    assert blocked == "refused"


def test_half_the_slider_is_half_way_between_the_colours(page):
    ends = [pixels(picture_of(page, camera(page), layer=1, amount=amount)) for amount in (0, 100)]
    half = pixels(picture_of(page, camera(page), layer=1, amount=50))
    covered = np.max(ends, axis=(0, 3)) < 250  # mixed before they are limited to what a display shows
    mean = np.mean(ends, axis=0)
    assert np.abs(half - mean)[covered].max() <= 3.0


@pytest.mark.parametrize("cvd", ["protan", "deutan", "tritan", "achromat"])
@pytest.mark.parametrize("severity", [1.0, 0.45])
def test_what_an_observer_sees_is_what_the_core_computes(page, cvd, severity):
    plain = pixels(picture_of(page, camera(page)))
    seen = pixels(picture_of(page, camera(page), observer=cvd, severity=severity))
    expected = simulate_bytes(plain, cvd, severity)
    assert float(delta_e_2000(image_to_tensor(seen), image_to_tensor(expected)).mean()) <= 0.5


def test_the_start_is_a_cameras_place_and_upright(page):
    found = page.evaluate("cvdgs.camera()")
    expected = camera(page, 1)
    np.testing.assert_allclose(found["rotation"], expected["rotation"], atol=1e-6)
    np.testing.assert_allclose(found["translation"], expected["translation"], atol=1e-6)
    page.get_by_role("button", name="Next photograph").click()
    np.testing.assert_allclose(page.evaluate("cvdgs.camera().rotation"), camera(page, 2)["rotation"], atol=1e-6)


def test_controls_change_what_is_shown_and_say_so(page):
    before = shown(page)
    amount = page.get_by_role("slider", name="From original to enhanced colours")
    amount.fill("0")
    page.wait_for_timeout(400)
    original = shown(page)
    assert not np.array_equal(before, original)
    assert page.locator("#tag-right").inner_text() == "Original colours"
    amount.fill("100")
    page.get_by_role("radio", name="for tritan-0.5").check()
    assert "tritan gains" in page.locator("#caption").inner_text()
    page.get_by_role("radio", name="protan").check()
    page.get_by_role("slider", name="Severity").fill("0.5")
    page.wait_for_timeout(400)
    assert "as protan vision of severity 0.5 sees it" in page.locator("#tag-right").inner_text()
    assert not np.array_equal(original, shown(page))


def test_the_wipe_shows_original_colours_on_its_left(page):
    page.get_by_text("Compare side by side").click()
    page.get_by_role("slider", name="Where original and enhanced meet").fill("30")
    page.wait_for_timeout(400)
    compared = page.evaluate("({ ...cvdgs.camera() })")
    both = pixels(picture_of(page, compared, layer=1))
    page.get_by_text("Compare side by side").click()
    original, enhanced = (pixels(picture_of(page, compared, layer=1, amount=amount)) for amount in (0, 100))
    edge = round(0.3 * both.shape[1])
    np.testing.assert_array_equal(both[:, : edge - 1], original[:, : edge - 1])
    np.testing.assert_array_equal(both[:, edge + 1 :], enhanced[:, edge + 1 :])


def test_everything_can_be_done_with_keys(page):
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "view"
    start = page.evaluate("cvdgs.camera()")
    for keys, changed in ((["ArrowLeft"], "rotation"), (["+"], "translation"), (["Shift+ArrowUp"], "translation")):
        before = page.evaluate("cvdgs.camera()")
        for key in keys:
            page.keyboard.press(key)
        assert page.evaluate("cvdgs.camera()")[changed] != before[changed]
    page.keyboard.press("Home")
    assert page.evaluate("cvdgs.camera().rotation") == start["rotation"]
    page.keyboard.press("Space")
    assert page.locator("#said").text_content() == "Original colours"
    with page.expect_download() as download:
        page.keyboard.press("s")
    assert download.value.suggested_filename == "original-colours.png"
    reached = set()
    for _ in range(30):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.name"))
    assert {"amount", "wipes", "layer", "observer", "home", "previous", "next", "still"} <= reached


def test_a_saved_picture_is_a_png_of_the_view(page, tmp_path):
    with page.expect_download() as download:
        page.get_by_role("button", name="Save picture").click()
    download.value.save_as(tmp_path / "saved.png")
    with Image.open(tmp_path / "saved.png") as picture:
        assert picture.format == "PNG"
        assert picture.size == tuple(page.evaluate("[cvdgs.canvas.clientWidth, cvdgs.canvas.clientHeight]"))


def test_every_control_has_a_name_for_screen_readers(page):
    for role in ("slider", "button", "radio", "checkbox", "application"):
        controls = page.get_by_role(role)
        assert controls.count()
    names = page.evaluate(
        """[...document.querySelectorAll("input, button, canvas")].filter((control) => control.checkVisibility())
           .map((control) => control.ariaLabel || (control.labels?.[0] ?? control).textContent.trim())"""
    )
    assert all(names)
    assert page.locator("#said").get_attribute("aria-live") == "polite"


def test_on_a_phone_nothing_overflows_and_fingers_turn_and_zoom(running, path):
    page = running.new_context(viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=2).new_page()
    open_viewer(page, path)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    for control in page.locator("button:visible, .choices label").all():
        assert control.bounding_box()["height"] >= 30.0
    box = page.locator("#view").bounding_box()
    assert box["height"] >= 0.4 * PHONE["height"]
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    before = page.evaluate("({yaw: cvdgs.orbit.yaw, distance: cvdgs.orbit.distance})")
    fingers = page.context.new_cdp_session(page)
    touch(fingers, [[middle], [(middle[0] + 60, middle[1])]])
    turned = page.evaluate("({yaw: cvdgs.orbit.yaw, distance: cvdgs.orbit.distance})")
    assert turned["yaw"] != before["yaw"]
    touch(fingers, [[(middle[0] + side * reach, middle[1]) for side in (-1, 1)] for reach in (30, 60)])
    assert page.evaluate("cvdgs.orbit.distance") < turned["distance"]
    page.context.close()


def touch(session: Any, moments: list[list[tuple[float, float]]]) -> None:
    """Fingers at the points of each of `moments`, down at the first and up after the last."""
    for kind, points in [
        ("touchStart", moments[0]),
        *(("touchMove", points) for points in moments[1:]),
        ("touchEnd", []),
    ]:
        known = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": known})


def test_a_scene_without_layers_or_cameras_is_shown_too(running, tmp_path):
    write_web_page(tmp_path / "scene.html", {"splats": layered(50)["original"]}, "z")
    page = running.new_page()
    open_viewer(page, tmp_path / "scene.html")
    assert not page.locator("#colours").is_visible()
    assert not page.locator("#next").is_visible()
    assert shown(page).max() > 100
    page.close()


def test_enhanced_colours_are_not_called_original_where_the_original_is_not_there(running, tmp_path):
    layers = layered(50)
    del layers["original"]
    write_web_page(tmp_path / "scene.html", layers, "", surroundings())
    page = running.new_page()
    open_viewer(page, tmp_path / "scene.html")
    assert page.locator("#amount-from").inner_text() == "Enhanced for deutan vision"
    assert page.locator("#amount-to").inner_text() == "Enhanced for tritan-0.5"
    page.get_by_text("Compare side by side").click()
    assert page.locator("#tag-left").inner_text() == "Enhanced for deutan vision"
    assert page.locator("#tag-right").inner_text() == "Enhanced for tritan-0.5"
    assert page.locator("#said").text_content() == "Enhanced for deutan vision beside enhanced for tritan-0.5"
    page.get_by_role("slider", name="From enhanced for deutan vision to enhanced for tritan-0.5").fill("0")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save picture").click()
    assert download.value.suggested_filename == "enhanced-for-deutan-vision.png"
    page.close()


def test_one_enhanced_layer_is_called_what_it_is(running, tmp_path):
    write_web_page(tmp_path / "scene.html", {"deutan-1.0": layered(50)["deutan-1.0"]}, "", surroundings())
    page = running.new_page()
    open_viewer(page, tmp_path / "scene.html")
    assert page.locator("#tag-right").inner_text() == "Enhanced for deutan vision"
    page.close()


def compared(line: Any) -> list[str]:
    """Sources of the two pictures that the report compares."""
    return [image.get_attribute("src") for image in line.locator("img").all()]


def captioned(page: Any, *endings: str) -> list[str]:
    """Sources of the first two pictures whose captions end so, in their order."""
    images = page.locator(".compared").first.locator("figure").all()
    return [
        figure.locator("img").get_attribute("src")
        for figure in images
        if figure.locator("figcaption").inner_text().endswith(endings)
    ][:2]


def test_the_report_opens_the_scene_on_a_click_and_compares_pictures(running, tmp_path):
    write_viewer(write_run(tmp_path))
    write_report_page(tmp_path)
    page = running.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "report.html").as_uri())
    line = page.locator(".compare").first
    left = line.locator(".line").bounding_box()["x"]
    line.get_by_role("slider").fill("90")
    assert line.locator(".line").bounding_box()["x"] > left
    assert compared(line) == captioned(page, "as deutan vision sees it"), "what this observer sees of both"
    line.get_by_role("checkbox", name="both as deutan vision sees them").uncheck()
    assert compared(line) == captioned(page, "photograph", "enhanced, rendered")
    (tmp_path / "viewer.html").unlink()  # the report needs no other file
    page.get_by_role("button", name="Open the scene").click()
    page.frame_locator("iframe").locator("html[data-ready]").wait_for()
    assert [url for url in asked if not url.startswith(("blob:", "data:", "about:"))] == [
        (tmp_path / "report.html").as_uri()
    ]
    page.close()


def test_without_webgl_the_pictures_are_shown_and_why(running, tmp_path):
    write_png(tmp_path / "still.png", np.full((30, 40, 3), 128, np.uint8))
    stills = [Still(tmp_path / "still.png", "Original <colours>")]
    write_web_page(tmp_path / "scene.html", layered(50), "", surroundings(stills=stills))
    plain = running.browser_type.launch(executable_path=find_browser(), args=list(WITHOUT_GRAPHICS))
    page = plain.new_page()
    page.goto((tmp_path / "scene.html").as_uri())
    page.wait_for_selector(".fails")
    assert "no WebGL 2" in page.locator("#cover").inner_text()
    assert page.get_by_role("img", name="Original <colours>").is_visible()
    assert not page.locator("#controls").is_visible()
    plain.close()


def test_of_many_gaussians_a_part_can_be_drawn(running, path):
    page = running.new_page()
    # As if few were many.
    text = path.read_text(encoding="utf-8").replace("const MANY = 300000;", "const MANY = 100;")
    other = path.with_name("many.html")
    other.write_text(text, encoding="utf-8")
    open_viewer(page, other)
    page.get_by_role("slider", name="Detail").fill("25")
    for _ in range(100):  # the page's policy forbids to wait by an expression
        if page.evaluate("cvdgs.renderer.drawn") == 100:
            break
        page.wait_for_timeout(100)
    assert page.evaluate("[cvdgs.count, cvdgs.renderer.drawn]") == [100, 100]
    page.close()
