"""A focal length that is off: seen in what a scene cannot hide, found, and told from cameras that are turned."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from cvdgs.core.capture.model import Capture, PinholeCamera
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.zoom import compensating_motion, zoom_slope
from cvdgs.core.splats.raster import ParameterSet, RasterCamera, Rasterizer
from cvdgs.core.splats.targets import Background
from cvdgs.core.splats.training.lens import FocalLength, LensCheck, LensPlan, LensSearch

from ..calibration.test_poses import BLACK, ball, photographs, turned


@pytest.fixture(scope="module")
def scene():
    return ball()


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene)


@pytest.fixture(scope="module")
def showroom() -> Capture:
    return read_capture(SHOWROOM, max_size=160)


class Fractions(Reporter):
    """Keeps what it is told of the progress."""

    def __init__(self) -> None:
        self.told: list[float] = []

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self.told.append(fraction)


def find(capture: Capture, plan: LensPlan | None = None, reporter: Reporter | None = None) -> FocalLength:
    check = LensCheck(Rasterizer("cpu", 2), capture.views, Background.of(capture.views), plan or LensPlan(), seed=0)
    return check.find(capture.points, capture.point_colors, reporter or Reporter())


def raster_camera(camera: PinholeCamera, world_to_camera: np.ndarray) -> RasterCamera:
    return RasterCamera(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, world_to_camera.astype(np.float64)
    )


def test_the_slope_is_that_of_the_loss_as_the_lens_grows(scene, views):
    """But for the Gaussians' axes, of which only the mean counts."""
    rng = np.random.default_rng(0)
    moved = replace(scene, means=scene.means + rng.normal(0.0, 0.02, scene.means.shape).astype(np.float32))
    rasterizer, parameters = Rasterizer("cpu", 1), ParameterSet.from_gaussians(moved)
    found, expected = [], []
    for view in views:
        camera = raster_camera(view.camera, view.world_to_camera)
        photograph = wp.array(view.image, dtype=wp.uint8)
        losses = []
        for factor in (0.999, 1.001):
            frame = rasterizer.render(parameters, camera.zoomed(factor), BLACK.color)
            losses.append(rasterizer.photometric_loss(frame, photograph).total)
        expected.append((losses[1] - losses[0]) / 0.002)
        frame = rasterizer.render(parameters, camera, BLACK.color)
        rasterizer.photometric_loss(frame, photograph)
        found.append(zoom_slope(parameters, rasterizer.backward(frame), camera))
    assert np.corrcoef(found, expected)[0, 1] > 0.98
    np.testing.assert_allclose(found, expected, atol=0.15 * np.abs(expected).max())


def test_the_motion_hides_all_but_what_it_says(scene, views):
    """Moved along while the lens grows, places stay in the images but for that share of how far they would move."""
    cameras = [raster_camera(view.camera, view.world_to_camera) for view in views]
    means = scene.means.astype(np.float64)
    motion, grown = compensating_motion(means, cameras), 1e-4
    moved = means + grown * (means @ motion.linear.T + motion.offset)
    plain, hidden = [], []
    for camera in cameras:
        before = image_of(means, camera)
        plain.append(image_of(means, camera.zoomed(math.exp(grown))) - before)
        hidden.append(image_of(moved, camera.zoomed(math.exp(grown))) - before)
    share = np.linalg.norm(hidden) / np.linalg.norm(plain)
    assert share == pytest.approx(motion.residual, rel=0.01)
    assert motion.growth < -0.5  # the scene shrinks


def image_of(means: np.ndarray, camera: RasterCamera) -> np.ndarray:
    local = means @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    return local[:, :2] / local[:, 2:] * (camera.fx, camera.fy)


@pytest.mark.parametrize(("turns", "least", "most"), [(0.0, 0.0, 0.01), (25.0, 0.3, 1.0)])
def test_one_place_tells_the_lens_only_by_looking_around(scene, turns, least, most):
    camera = PinholeCamera(144, 144, 100.0, 100.0, 72.0, 72.0)
    cameras = []
    for degrees in np.linspace(-turns, turns, 8):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        cameras.append(raster_camera(camera, pose))
    means = np.random.default_rng(0).uniform((-3.0, -1.0, 3.0), (3.0, 1.0, 5.0), (500, 3))
    assert least <= compensating_motion(means, cameras).residual <= most


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.96, 1.05, 1.2])
def test_a_focal_length_that_is_off_is_found(error):
    found = find(read_capture(SHOWROOM, max_size=112).zoomed(error))
    assert found.factor * error == pytest.approx(1.0, abs=0.01)
    assert found.words.startswith("corrected: it was")
    assert ("too long" if error > 1.0 else "too short") in found.words
    assert "dB in a trial" in found.words


def test_a_good_one_stays_to_the_last_digit(showroom):
    found = find(showroom)
    assert not found.was_off
    assert found.words.startswith("as given")


def test_a_lens_by_which_other_views_gain_nothing_is_left(showroom):
    short = LensSearch(20, 500, 80, 0.1, 6e-3, refines_poses=True)
    found = find(
        showroom,
        LensPlan(replace(short, refines_poses=False), 0.0, short, 0.0, good_poses=math.inf, least_gain=math.inf),
    )
    assert not found.was_off
    assert found.words.startswith("as given: it seems")
    assert "dB in a trial" in found.words


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.25, 0.5, 2.0])
def test_cameras_that_are_turned_are_not_taken_for_another_lens(showroom, degrees):
    views = tuple(turned(list(showroom.views), degrees))
    assert not find(replace(showroom, views=views)).was_off


def test_the_progress_falls_back_once_when_there_is_more_to_do_and_never_passes_the_end(showroom):
    short = LensSearch(20, 500, 80, 0.1, 6e-3, refines_poses=True)
    plan = LensPlan(first=replace(short, refines_poses=False), suspected=0.0, second=short, least=0.0)
    fractions = Fractions()
    find(showroom, plan, fractions)
    falls = [number for number, (a, b) in enumerate(pairwise(fractions.told)) if b < a]
    assert len(falls) == 1
    assert fractions.told[falls[0] + 1] == 0.0
    assert max(fractions.told) <= 1.0


def test_few_views_are_not_checked(showroom):
    assert find(replace(showroom.zoomed(1.05), views=showroom.views[:5])) == FocalLength()


def test_cut_outs_are_not_checked(showroom):
    covered = np.full(showroom.views[0].image.shape[:2], 255, np.uint8)
    views = tuple(replace(view, alpha=covered) for view in showroom.zoomed(1.05).views)
    assert find(replace(showroom, views=views)) == FocalLength()


def test_views_from_one_side_cannot_tell(showroom):
    """Eight of them within a step of each other, so that the scene can hide any lens."""
    first = showroom.views[0]
    views = []
    for i in range(8):
        pose = first.world_to_camera.copy()
        pose[0, 3] += 1e-3 * i
        views.append(first.at(pose))
    found = find(replace(showroom, views=tuple(views)))
    assert found == FocalLength(words="as given: these views cannot tell")
