"""The web page as a file: one geometry, small layers, nothing from outside, and names that are text."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cvdgs.core.color.matrices import linear_simulation
from cvdgs.core.color.srgb import decode, encode
from cvdgs.core.errors import InputError
from cvdgs.core.settings import CVD_TYPES
from cvdgs.core.splats.gaussians import SH_C0, Gaussians
from cvdgs.core.splats.io.files import most_important, write_layers
from cvdgs.core.splats.web import page as web_page
from cvdgs.core.splats.web.page import Surroundings, write_web_page
from cvdgs.core.splats.web.streams import pack

from ..sets import gaussians
from .scenes import layered, ring, surroundings

NODE = shutil.which("node") or shutil.which("nodejs")
VISITOR = Path(__file__).with_name("visitor.js")
in_node = pytest.mark.skipif(NODE is None, reason="needs node")


def scene_of(path: Path) -> dict[str, Any]:
    (text,) = re.findall(r'id="scene">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    return json.loads(text)


def numbers(data: str, width: int, kind: str) -> np.ndarray:
    """(N, width) numbers of a stream, by its description."""
    size = np.dtype(kind).itemsize
    planes = np.frombuffer(gzip.decompress(base64.b64decode(data)), np.uint8).reshape(width, size, -1)
    return np.ascontiguousarray(planes.transpose(2, 0, 1)).view(kind)[..., 0]


def test_numbers_come_back_within_their_steps():
    layers = layered(200, degree=2)
    first, origin = layers["original"], np.array([5.0, -3.0, 100.0])
    first = replace(first, means=(first.means + origin).astype(np.float32))
    streams = pack({**layers, "original": first}, origin)
    order = np.argsort(-first.importance, kind="stable")
    np.testing.assert_allclose(numbers(streams.data["means"], 3, "<f4") + origin, first.means[order], atol=1e-5)
    shapes = numbers(streams.data["shapes"], 8, "<u2")
    low, step = streams.description["scaleCode"]
    np.testing.assert_allclose(low + step * shapes[:, 4:7], first.log_scales[order], atol=0.51 * step + 1e-6)
    np.testing.assert_allclose(shapes[:, 7] / 65535.0, first.opacities[order], atol=1e-5)
    unit = first.quaternions / np.linalg.norm(first.quaternions, axis=1, keepdims=True)
    np.testing.assert_allclose(shapes[:, :4].view(np.int16) / 32767.0, unit[order], atol=2e-5)
    colors = numbers(streams.data["colors0"], 3, "<f2")
    np.testing.assert_allclose(colors, 0.5 + SH_C0 * first.sh[order, 0], atol=2e-3)
    low, step = streams.description["layers"][0]["restCode"]
    rest = low + step * numbers(streams.data["rest0"], 24, "u1")
    np.testing.assert_allclose(rest, first.sh[order, 1:].reshape(-1, 24), atol=0.51 * step + 1e-6)


def test_a_gaussian_with_absurd_colours_takes_no_precision_from_the_others():
    first = layered(2000, degree=3)["original"]
    sh = first.sh.copy()
    sh[7, 1:] = 50.0
    streams = pack({"original": replace(first, sh=sh)}, np.zeros(3))
    low, step = streams.description["layers"][0]["restCode"]
    rest = low + step * numbers(streams.data["rest0"], 45, "u1").reshape(-1, 15, 3)
    order = np.argsort(-first.importance, kind="stable")
    others = order != 7
    np.testing.assert_allclose(rest[others], first.sh[order, 1:][others], atol=0.01)
    assert (rest[~others] > 0.9).all()


def test_a_further_layer_takes_no_more_than_its_colours(tmp_path):
    count = 3000
    layers = layered(count)
    sizes = []
    for names in (["original"], ["original", "deutan-1.0"]):
        write_web_page(tmp_path / "scene.html", {name: layers[name] for name in names})
        sizes.append((tmp_path / "scene.html").stat().st_size)
    assert (sizes[1] - sizes[0]) / count <= 12.0


def test_the_page_asks_for_nothing(tmp_path):
    write_web_page(tmp_path / "scene.html", layered(20))
    text = (tmp_path / "scene.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert not re.search(r"""(src|href)=["']?(?!["']?data:)""", text)
    assert re.findall(r"https?://\S+", text) == ["https://www.gnu.org/licenses/gpl-3.0.html"]  # said, not asked for


def test_names_from_outside_are_text(tmp_path):
    evil = '</script><script>alert("{{ style }}")</script>'
    layers = layered(20)
    around = Surroundings(title=evil, lead=evil, credit=evil, captions={evil: evil}, names={evil: evil})
    write_web_page(tmp_path / "scene.html", {"original": layers["original"], evil: layers["deutan-1.0"]}, "", around)
    text = (tmp_path / "scene.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "{{ style }}" in text  # as it was given
    scene = scene_of(tmp_path / "scene.html")
    assert (scene["layers"][1]["name"], scene["names"][1], scene["captions"][1]) == (evil, evil, evil)


@pytest.mark.parametrize(("up", "direction"), [("z", [0.0, 0.0, 1.0]), ("0,-3,4", [0.0, -0.6, 0.8])])
def test_original_colours_come_first_and_without_cameras_a_direction_is_up(tmp_path, up, direction):
    layers = layered(20)
    write_layers(tmp_path / "scene.html", dict(reversed(layers.items())), up=up)
    scene = scene_of(tmp_path / "scene.html")
    assert scene["layers"][0]["name"] == "original"
    assert scene["up"] == pytest.approx(direction)
    assert scene["cameras"] == []


def test_a_camera_of_the_page_sees_the_gaussians_where_that_of_the_capture_does(tmp_path):
    layers = layered(300)
    first = layers["original"]
    layers = {"original": replace(first, means=first.means + np.float32([0.4, -0.3, 0.2]))}
    write_web_page(tmp_path / "scene.html", layers, "", surroundings())
    streams = re.findall(r'id="data-means">(.*?)</script>', (tmp_path / "scene.html").read_text(encoding="utf-8"))
    means = numbers(streams[0], 3, "<f4")
    order = np.argsort(-first.importance, kind="stable")
    for camera, view in zip(scene_of(tmp_path / "scene.html")["cameras"], ring(), strict=True):
        seen = means @ np.reshape(camera["rotation"], (3, 3)).T + camera["translation"]
        expected = layers["original"].means[order] @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]
        np.testing.assert_allclose(seen, expected, atol=1e-5)


def test_of_more_cameras_than_a_page_holds_the_one_in_which_it_begins_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(web_page, "_MOST_CAMERAS", 3)
    write_web_page(tmp_path / "scene.html", layered(5), "", surroundings(views=ring(10), start="view5"))
    scene = scene_of(tmp_path / "scene.html")
    assert scene["cameras"][scene["start"]]["name"] == "view5"
    assert len(scene["cameras"]) == 4  # and three or fewer of all sides


@pytest.mark.parametrize(
    ("names", "title"),
    [
        (["deutan-1.0", "original"], "Original"),
        (["deutan-1.0"], "Enhanced for deutan vision"),
        (["tritan-0.5", "deutan-1.0"], "Enhanced for tritan-0.5"),
        (["garden"], "garden"),
    ],
)
def test_the_first_colours_are_called_original_only_if_they_are(tmp_path, names, title):
    layers = {name: layered(5).get(name, gaussians(5)) for name in names}
    write_web_page(tmp_path / "scene.html", layers, "", Surroundings(names={"deutan-1.0": "deutan vision"}))
    assert scene_of(tmp_path / "scene.html")["first"] == title


def test_no_gaussians_are_refused_and_nothing_is_left(tmp_path):
    with pytest.raises(InputError, match="no Gaussians"):
        write_web_page(tmp_path / "scene.html", {"original": gaussians(0)})
    assert list(tmp_path.iterdir()) == []


def test_more_than_a_browser_can_draw_are_refused_and_a_budget_is_offered(tmp_path, monkeypatch):
    monkeypatch.setattr(web_page, "_ENOUGH_TO_SORT", 10)
    with pytest.raises(InputError, match="--gaussians"):
        write_web_page(tmp_path / "scene.html", {"original": gaussians(11)})


def test_the_most_important_gaussians_stay_in_their_order():
    layers = layered(50)
    kept = most_important(layers, 20)
    first = layers["original"]
    chosen = np.sort(np.argsort(-first.importance, kind="stable")[:20])
    for name, part in kept.items():
        np.testing.assert_array_equal(part.means, first.means[chosen])
        np.testing.assert_array_equal(part.sh, layers[name].sh[chosen])
    assert most_important(layers, 50) == layers


def test_a_thin_sheet_is_more_important_than_a_smaller_ball():
    """Surfaces are made of sheets: what is seen of one is its area, however thin it is."""
    first = layered(2)["original"]
    log_scales = np.log(np.array([[1.0, 1.0, 1e-6], [0.5, 0.5, 0.5]], np.float32))
    sheet, ball = replace(first, log_scales=log_scales, opacity_logits=np.zeros(2, np.float32)).importance
    assert sheet == pytest.approx(4.0 * ball)


@pytest.mark.filterwarnings("error")
def test_gaussians_larger_than_numbers_can_hold_are_ranked_by_their_opacity_and_above_smaller_ones():
    first = layered(5)["original"]
    log_scales = np.zeros((5, 3), np.float32)
    log_scales[1:] = 500.0
    log_scales[4] = 3e38
    logits = np.array([0.0, -1000.0, 1.0, 2.0, 3.0], np.float32)
    ranked = np.argsort(-replace(first, log_scales=log_scales, opacity_logits=logits).importance, kind="stable")
    assert ranked.tolist() == [4, 3, 2, 0, 1]


@pytest.mark.parametrize("model", ["machado", "vienot", "brettel"])
def test_matrices_between_the_steps_are_those_of_the_simulation(tmp_path, model):
    write_web_page(tmp_path / "scene.html", layered(5), "", Surroundings(model=model))
    tables = scene_of(tmp_path / "scene.html")["simulation"]
    assert set(tables) == set(CVD_TYPES)
    for cvd, table in tables.items():
        expected = linear_simulation(cvd, 0.63, "brettel" if (model, cvd) == ("vienot", "tritan") else model)
        above, below = (0.7 * np.array(table[side][6]) + 0.3 * np.array(table[side][7]) for side in ("above", "below"))
        np.testing.assert_allclose(above.reshape(3, 3), expected.matrix, atol=1e-9)
        if expected.matrix_below is not None and expected.separator is not None:
            np.testing.assert_allclose(below.reshape(3, 3), expected.matrix_below, atol=1e-9)
            np.testing.assert_allclose(table["separator"], expected.separator)


def test_its_own_colours_have_contrast_for_everyone():
    """WCAG 2.2: 7 for text, 3 for what marks focus and edges, however they are seen."""
    css = (Path(web_page.__file__).parent / "viewer.css").read_text(encoding="utf-8")
    colors = dict(re.findall(r"--(\w+): #([0-9a-f]{6});", css))
    pairs = [("ink", "paper", 7.0), ("ink", "soft", 7.0), ("line", "paper", 3.0), ("focus", "paper", 3.0)]
    for cvd in CVD_TYPES:
        for first, second, least in pairs:
            bright, dark = sorted((luminance_seen(colors[name], cvd) for name in (first, second)), reverse=True)
            assert (bright + 0.05) / (dark + 0.05) >= least, (cvd, first, second)


def luminance_seen(code: str, cvd: str) -> float:
    light = decode(np.array([int(code[place : place + 2], 16) for place in (0, 2, 4)]) / 255.0)
    seen = np.clip(linear_simulation(cvd, 1.0).matrix @ light, 0.0, 1.0)
    return float(decode(encode(seen)) @ (0.2126, 0.7152, 0.0722))


def test_colours_beyond_what_half_floats_hold_are_limited():
    wild = gaussians(2)
    wild.sh[:] = 1e6
    streams = pack({"original": Gaussians(**vars(wild))}, np.zeros(3))
    assert np.isfinite(numbers(streams.data["colors0"], 3, "<f2")).all()


def opened(folder: Path, fault: str) -> dict[str, Any]:
    """What a visitor has before him whose browser fails so; see visitor.js."""
    write_web_page(folder / "scene.html", layered(400, degree=1), "", surroundings())
    done = subprocess.run([NODE, VISITOR, folder / "scene.html", fault], capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@in_node
@pytest.mark.parametrize("fault", ["none", "worker refused", "worker blocked", "worker breaks"])
def test_the_scene_opens_where_the_browser_allows_no_worker_too(tmp_path, fault):
    found = opened(tmp_path, fault)
    assert (found["opens"], found["fails"], found["drawn"]) == (True, False, 400)


@in_node
@pytest.mark.parametrize(
    ("fault", "said"), [("context lost", "graphics card was taken away"), ("memory full", "too large for this")]
)
def test_that_the_graphics_card_fails_while_the_scene_loads_is_said(tmp_path, fault, said):
    found = opened(tmp_path, fault)
    assert (found["opens"], found["fails"]) == (False, True)
    assert said in found["said"]
