"""A run on photographs with masks, and what it says of them and of the floaters that it removed."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cvdgs.core.capture.reader import read_capture
from cvdgs.core.errors import InputError
from cvdgs.core.pipeline.run import run
from cvdgs.core.runs.report import write_report
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.io.ply import read_floaters, read_ply

from ...few_views import write_few_views

VIEWS = 10


def masked_capture(folder: Path, color: tuple[int, int, int]) -> Path:
    """Some of the demo's photographs, every other one with a patch of `color` behind a mask."""
    write_few_views(folder, VIEWS, 0.2)
    for index, path in enumerate(sorted((folder / "images").iterdir())):
        if index % 2 == 0:
            image = np.asarray(Image.open(path).convert("RGB")).copy()
            mask = np.full(image.shape[:2], 255, np.uint8)
            # Within JPEG's blocks of 16 pixels, so that no colour leaks out.
            image[16:48, 16 + 4 * index // 16 * 16 : 64] = color
            mask[16:48, 16 + 4 * index // 16 * 16 : 64] = 0
            image_path = path.with_suffix(".png")
            Image.fromarray(image).save(image_path)
            image_path.replace(path)
            (folder / "masks").mkdir(exist_ok=True)
            Image.fromarray(mask).save(folder / "masks" / f"{path.name}.png")
    return folder


def made(folder: Path, capture: Path, **options) -> tuple[Path, dict]:
    folder.mkdir(exist_ok=True)
    settings = Settings(
        capture=str(capture), out=str(folder), iterations=40, gaussians=1500, enhancer="lut", device="cpu", **options
    )
    report = run(settings, folder, Reporter())
    write_report(folder, report)
    return folder, report


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    base = tmp_path_factory.mktemp("masked")
    return made(base / "out", masked_capture(base / "capture", (255, 0, 255)), clean=0.75)


def test_the_report_says_how_much_is_masked_and_what_was_removed(finished: tuple[Path, dict]) -> None:
    folder, report = finished
    views = read_capture(folder / "capture", max_size=None).views
    masks = [view.mask for view in views]
    hidden = sum(int((~mask).sum()) for mask in masks if mask is not None)
    assert report["capture"]["masks"]["views"] == sum(mask is not None for mask in masks) == VIEWS // 2
    assert report["capture"]["masks"]["share"] == pytest.approx(hidden / sum(v.image[..., 0].size for v in views), 1e-3)
    assert any(warning["name"] == "masks" for warning in report["warnings"])
    assert report["clean"]["share"] == pytest.approx(
        report["clean"]["removed"] / (report["gaussians"] + report["clean"]["removed"])
    )
    # The colours of what is left are fitted once more.
    assert report["clean"]["psnr_after"] < report["reconstruction"]["psnr"]
    assert "removed as floaters" in report["decision"]["clean"]


def test_the_gaussians_carry_the_scores_of_what_is_left(finished: tuple[Path, dict]) -> None:
    folder, report = finished
    scores = read_floaters(folder / "splats.ply")
    assert scores is not None
    assert len(scores) == len(read_ply(folder / "splats.ply")) == report["gaussians"]
    assert scores.max() <= 0.25
    assert read_floaters(folder / "splats.deutan-1.0.ply") is None


def test_whatever_is_masked_the_result_is_the_same(finished: tuple[Path, dict], tmp_path: Path) -> None:
    folder, report = finished
    other, again = made(tmp_path / "out", masked_capture(tmp_path / "capture", (0, 255, 0)), clean=0.75)
    for name in ("splats.ply", "splats.deutan-1.0.ply", "layer.deutan-1.0.cube"):
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name
    assert report["reconstruction"] == again["reconstruction"]
    for name, figures in report["layers"]["deutan-1.0"].items():
        assert figures == again["layers"]["deutan-1.0"][name], name


@pytest.mark.slow
def test_a_layer_is_added_to_a_run_with_masks(finished: tuple[Path, dict], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished[0], tmp_path / "out"))
    capture = finished[1]["settings"]["capture"]
    settings = Settings(
        capture=capture, out=str(folder), enhancer="lut", device="cpu", resume=True, layers=(Layer("tritan", 1.0),)
    )
    assert {"deutan-1.0", "tritan-1.0"} == set(run(settings, folder, Reporter())["layers"])


def test_a_mask_that_has_changed_since_the_run_is_named(finished: tuple[Path, dict], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished[0], tmp_path / "out"))
    capture = Path(shutil.copytree(finished[1]["settings"]["capture"], tmp_path / "capture"))
    mask = next((capture / "masks").iterdir())
    Image.fromarray(255 - np.asarray(Image.open(mask))).save(mask)
    settings = Settings(
        capture=str(capture), out=str(folder), enhancer="lut", device="cpu", resume=True, layers=(Layer("tritan", 1.0),)
    )
    with pytest.raises(InputError, match=r"the mask of '.*' has changed since the run"):
        run(settings, folder, Reporter())
