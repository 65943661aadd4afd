"""Renderings of the modes from cameras between held-out ones, where no photograph was taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.spatial.transform import Rotation, Slerp

from ....core.capture.model import View
from ....core.color.spaces import delta_e_76, image_to_tensor, srgb_to_lab
from ....core.errors import InputError
from ....core.evaluate.evaluation import SceneMatches
from ....core.files.images import read_png, write_png
from ....core.runs.layout import ORIGINAL
from ....core.runtime.protocol import Reporter
from ....core.splats import raster
from ....core.splats.renderer import SceneRenderer
from ....core.splats.targets import Background
from .captures import Subject
from .recipe import Recipe
from .trials import CaptureTrials

STAGE = "figure"
COMPARED = ("post", "joint", "layers")
_ENDS = "between.txt"  # written last

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class NovelViews:
    """Pictures along a path of cameras.

    Attributes:
        between: the held-out views at the ends of the path.
        pictures: (H, W, 3) from every camera, in `ORIGINAL` colours and for every mode of `COMPARED`.
    """

    between: tuple[str, str]
    pictures: Mapping[str, Sequence[Image]]


def camera_path(first: View, second: View, count: int) -> list[View]:
    """`count` views spaced evenly between two others, without these, with the first one's intrinsics."""
    to_world = [np.linalg.inv(view.world_to_camera) for view in (first, second)]
    turn = Slerp([0.0, 1.0], Rotation.from_matrix([pose[:3, :3] for pose in to_world]))
    path = []
    for number, fraction in enumerate(np.linspace(0.0, 1.0, count + 2)[1:-1]):
        pose = np.eye(4)
        pose[:3, :3] = turn(fraction).as_matrix()
        pose[:3, 3] = (1.0 - fraction) * to_world[0][:3, 3] + fraction * to_world[1][:3, 3]
        path.append(replace(first, key=f"novel_{number:03d}", world_to_camera=np.linalg.inv(pose), alpha=None))
    return path


def novel_views(
    name: str, subject: Subject, recipe: Recipe, count: int, folder: Path, reporter: Reporter
) -> NovelViews:
    """Renderings of every mode on the path between the two held-out cameras in the middle of the capture.

    Args:
        name: of the capture.
        recipe: for all modes.
        count: number of cameras.
        folder: for the files of the runs.

    Raises:
        InputError: fewer than two views are held out.
    """
    held_out = [subject.judged.views[i] for i in subject.judged_split.test]
    if len(held_out) < 2:
        raise InputError("fewer than two views are held out", where=name, remedy="use a capture of nine views or more")
    middle = (len(held_out) - 1) // 2
    ends = held_out[middle], held_out[middle + 1]
    raster.load("cpu", reporter)
    views, background = camera_path(*ends, count), Background.of(subject.judged.views)
    scene = SceneRenderer(raster.Rasterizer("cpu"), views, background)
    trials = CaptureTrials(name, subject, SceneMatches([], [], []), folder)
    pictures: dict[str, list[Image]] = {}
    for done, mode in enumerate(COMPARED):
        reporter.progress(STAGE, done / len(COMPARED), f"{name}, {recipe.enhancer}: {mode}")
        made = trials.make(replace(recipe, label=mode, mode=mode))
        pictures[mode] = [made.picture(scene, index) for index in range(count)]
        if mode == COMPARED[0]:
            pictures[ORIGINAL] = [scene.color(made.original, index) for index in range(count)]
    trials.close()
    reporter.progress(STAGE, 1.0, f"{name}, {recipe.enhancer}")
    return NovelViews((ends[0].key, ends[1].key), pictures)


def cached_novel_views(folder: Path, make: Callable[[], NovelViews]) -> NovelViews:
    """The pictures stored in `folder` by an earlier call; otherwise those of `make`, which are stored."""
    ends = folder / _ENDS
    if not ends.is_file():
        views = make()
        for name, images in views.pictures.items():
            for number, image in enumerate(images):
                write_png(folder / name / f"{number:03d}.png", image)
        ends.write_text("\n".join(views.between), encoding="utf-8")
        return views
    first, second = ends.read_text(encoding="utf-8").splitlines()
    names = (ORIGINAL, *COMPARED)
    pictures = {name: [read_png(file) for file in sorted((folder / name).glob("*.png"))] for name in names}
    return NovelViews((first, second), pictures)


def least_steady_step(pictures: Mapping[str, Sequence[Image]], unsteady: str, steady: str) -> int:
    """The camera at which the change to the next one is largest relative to the steady mode's, in mean ΔE76."""
    changes = {
        mode: [float(_difference(*pair).mean()) for pair in zip(pictures[mode][:-1], pictures[mode][1:], strict=True)]
        for mode in (unsteady, steady)
    }
    return int(np.argmax(np.subtract(changes[unsteady], changes[steady])))


def window_of_disagreement(
    pictures: Mapping[str, Sequence[Image]], cameras: Sequence[int], side: int
) -> tuple[int, int]:
    """Row and column of the upper left corner of the square where the compared modes differ most.

    Args:
        cameras: the cameras to compare.
        side: of the square in pixels.
    """
    pairs = [(a, b) for i, a in enumerate(COMPARED) for b in COMPARED[i + 1 :]]
    apart = np.mean([_difference(pictures[a][c], pictures[b][c]) for c in cameras for a, b in pairs], axis=0)
    # The filter averages the square around each pixel; only squares inside the picture count.
    around = uniform_filter(apart, side, mode="nearest")
    before, after = side // 2, side - side // 2
    inside = around[before : apart.shape[0] - after + 1, before : apart.shape[1] - after + 1]
    row, column = np.unravel_index(np.argmax(inside), inside.shape)
    return int(row), int(column)


def _difference(first: Image, second: Image) -> NDArray[np.float32]:
    """(H, W) ΔE76."""
    lab = [srgb_to_lab(image_to_tensor(image)) for image in (first, second)]
    return delta_e_76(*lab).numpy()
