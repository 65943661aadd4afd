"""The page of a batch: made by Blender and the standard library from pictures as small as they can be."""

from __future__ import annotations

import base64
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

from cvdgs.core.batch import page
from cvdgs.core.batch.page_markup import write_batch_page
from cvdgs.core.batch.previews import PREVIEWS_FOLDER
from cvdgs.core.batch.task import Kind, Task
from cvdgs.core.files.images import write_png
from cvdgs.core.rendering.requests import PageArguments
from cvdgs.core.runs.layout import picture_name

FRAMES = 3
REPORT = {
    "settings": {"simulation": "vienot"},
    "gaussians": 36453,
    "reconstruction": {"psnr": 34.093},
    "layers": {
        "deutan-1.0": {
            "ccpr": {"input": 0.654, "enhanced": 0.898, "unenhanced": 0.548, "rendered": 0.763, "tau": 6},
            "ssim_simulated": {"input": 0.95, "enhanced": 0.91, "unenhanced": 0.91, "rendered": None},
            "naturalness": {"ssim": 0.95, "psnr": 26.4, "delta_e": 4.33},
            "rwe": {"ratio": 0.861, "enhanced_ratio": 1.184},
        }
    },
}


class Elements(HTMLParser):
    """All elements of a page with their attributes, and its text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, {name: value or "" for name, value in attributes}))

    def handle_data(self, data):
        self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.elements if name == tag]


def write_sequence(folder: Path, level: int) -> None:
    for number in range(1, FRAMES + 1):
        picture = np.full((36, 48, 3), level, np.uint8)
        picture[:, : 12 * number, 0] = 220
        write_png(folder / picture_name(number), picture)


def turntable(layer: str, folder: str, **others) -> dict:
    common = {"engine": "cycles", "camera": "level", "frames": FRAMES, "frames_per_second": 6}
    return {**common, "layer": layer, "folder": folder, "simulated": {}, "video": None, "side_by_side": {}, **others}


def make(out: Path, *items: dict) -> Elements:
    arguments = PageArguments("Autumn <2026>", items, "index.html").to_dict()
    page.run(Task("page", Kind.PAGE, arguments=arguments), out, lambda event: None)
    return Elements((out / "index.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def batch(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("batch")
    write_sequence(out / "sofa" / "original", 60)
    write_sequence(out / "sofa" / "deutan", 120)
    (out / "run").mkdir()
    (out / "run" / "report.json").write_text(json.dumps(REPORT))
    return out


SOFA = {
    "name": "sofa & chair",
    "run": "run",
    "sheet": None,
    "turntables": [turntable("original", "sofa/original"), turntable("deutan-1.0", "sofa/deutan")],
}
FAILED = {"name": "curtain", "run": "nowhere", "sheet": None, "turntables": [turntable("original", "curtain/original")]}


@pytest.fixture(scope="module")
def made(batch) -> Elements:
    return make(batch, SOFA, FAILED)


def test_the_page_is_one_file_that_fetches_nothing(batch, made):
    sources = [attributes["src"] for _, attributes in made.elements if "src" in attributes]
    assert sources
    assert all(source.startswith("data:") for source in sources)
    text = (batch / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"https?://|@import|url\(", text)
    assert [path.name for path in batch.glob(".index*")] == []


def test_original_and_enhanced_play_in_one_video_as_everybody_and_as_the_observer_sees_them(made):
    (video,) = made.all("video")
    content = base64.b64decode(video["src"].removeprefix("data:video/mp4;base64,"))
    assert content[4:8] == b"ftyp"
    assert {"loop", "muted", "playsinline"} <= video.keys()
    for caption in ("Original", "Enhanced", "Original, as deutan vision sees it", "Enhanced, as deutan vision sees it"):
        assert caption in made.text
    values = {(radio["class"], radio["value"]) for radio in made.all("input") if radio["type"] == "radio"}
    assert {("colours", "first"), ("colours", "second"), ("seen", "normal"), ("seen", "observer")} <= values


def test_a_turntable_has_the_proportions_of_its_frames(made):
    (style,) = (division["style"] for division in made.all("div") if "stage" in division.get("class", "").split())
    assert "--width: 48; --height: 36" in style


def test_the_figures_are_those_of_the_runs_report(made):
    for figure in ("36,453 Gaussians", "34.09 dB", "0.654", "0.548", "0.763", "4.3", "1.18", "0.86"):
        assert figure in made.text
    assert "0.763" in made.text.split("Contrast preserved")[1].split("Structure")[0]


def test_what_is_not_there_is_said_to_be_missing(made):
    assert "Not complete: curtain" in made.text
    assert "some of its frames are missing" in made.text


def test_every_control_has_a_name_of_its_own_and_one_choice_is_made(made):
    radios: dict[str, list[bool]] = {}
    for radio in made.all("input"):
        if radio["type"] == "radio":
            radios.setdefault(radio["name"], []).append("checked" in radio)
    assert radios
    assert all(sum(checked) == 1 for checked in radios.values())
    identifiers = [attributes["id"] for _, attributes in made.elements if "id" in attributes]
    assert len(set(identifiers)) == len(identifiers)
    targets = {link["href"].removeprefix("#") for link in made.all("a") if link["href"].startswith("#")}
    assert targets <= set(identifiers)


def test_the_page_of_an_items_scene_is_offered_where_its_run_has_one(batch, made, tmp_path):
    assert not [link for link in made.all("a") if link["href"].endswith("viewer.html")]
    run = tmp_path / "a run"
    shutil.copytree(batch / "run", run)
    (run / "viewer.html").write_text("the scene")
    write_batch_page(PageArguments("Autumn", ({**SOFA, "run": str(run)},), "open.html"), batch)
    offered = Elements((batch / "open.html").read_text(encoding="utf-8"))
    (link,) = [a for a in offered.all("a") if a["href"].endswith("viewer.html")]
    assert (batch / unquote(link["href"])).read_text() == "the scene"


def test_names_are_text_and_not_markup(made):
    assert "Autumn <2026>" in made.text
    assert "sofa & chair" in made.text


def test_made_again_only_changed_previews_are_made_again(batch, made):
    previews = batch / PREVIEWS_FOLDER
    before = {path: path.stat().st_mtime_ns for path in previews.iterdir()}
    assert len(before) == 2
    make(batch, SOFA, FAILED)
    assert {path: path.stat().st_mtime_ns for path in previews.iterdir()} == before
    write_sequence(batch / "sofa" / "deutan", 180)
    make(batch, SOFA, FAILED)
    assert not set(previews.iterdir()) & set(before)


def test_videos_that_would_make_the_page_too_large_lie_beside_it(batch, made):
    write_batch_page(PageArguments("Autumn", (SOFA, FAILED), "small.html"), batch, most_embedded=10)
    linked = Elements((batch / "small.html").read_text(encoding="utf-8"))
    (video,) = linked.all("video")
    assert (batch / video["src"]).read_bytes()[4:8] == b"ftyp"
    assert "1 video did not fit into this file" in linked.text
