"""Given poses that are far off are replaced where views that are held back gain by it, and others are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.capture.model import Capture
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.capture.source import OPENGL_TO_OPENCV
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.targets import Background
from cvdgs.core.splats.training.given_cameras import GivenPoses, PoseCheck
from cvdgs.core.splats.training.initialise import InitialGaussians
from cvdgs.core.splats.training.short_fit import ShortFit

from ...capture.test_view_matches import turned
from .test_lens import Fractions


@pytest.fixture(scope="module")
def showroom() -> Capture:
    return read_capture(SHOWROOM, max_size=160)


def check(capture: Capture, least_gain: float = 0.1, reporter: Reporter | None = None) -> GivenPoses:
    fit = ShortFit(Rasterizer("cpu", 2), Background.of(capture.views), 100, 3000, 80, 0.2, InitialGaussians())
    train = [index for index in range(len(capture.views)) if index % 8]
    return PoseCheck(fit, 6, least_gain, seed=0).find(capture, train, reporter or Reporter())


def test_right_poses_are_not_suspected(showroom):
    found = check(showroom)
    assert found.fitting > 0.95
    assert found.words == ""
    assert found.replaced(showroom).views[3].world_to_camera is showroom.views[3].world_to_camera


def test_poses_that_are_off_are_replaced_and_the_reason_is_told(showroom):
    given, reporter = turned(showroom, 3.0), Fractions()
    found = check(given, reporter=reporter)
    assert found.were_off
    assert found.words.startswith("corrected: only ")
    assert " dB in a trial" in found.words
    replaced = found.replaced(given)
    assert replaced.points is given.points  # they are more than the matches give
    off = [
        np.linalg.norm(new.world_to_camera[:3, :3] - old.world_to_camera[:3, :3])
        for new, old in zip(replaced.views, showroom.views, strict=True)
    ]
    before = [
        np.linalg.norm(new.world_to_camera[:3, :3] - old.world_to_camera[:3, :3])
        for new, old in zip(given.views, showroom.views, strict=True)
    ]
    assert np.mean(off) < 0.5 * np.mean(before)
    assert reporter.told == sorted(reporter.told)
    assert 0.9 < max(reporter.told) <= 1.0


def test_without_sparse_points_those_of_the_matches_are_taken(showroom):
    nothing = np.zeros((0, 3))
    given = replace(turned(showroom, 3.0), points=nothing.astype(np.float32), point_colors=nothing.astype(np.uint8))
    replaced = check(given).replaced(given)
    assert len(replaced.points) == len(replaced.point_colors) > 300


def test_poses_stay_where_others_gain_too_little(showroom):
    given = turned(showroom, 3.0)
    found = check(given, least_gain=100.0)
    assert not found.were_off
    assert found.words.startswith("as given: only ")
    assert found.replaced(given).views[0].world_to_camera is given.views[0].world_to_camera


def test_poses_stay_where_too_little_holds_others(showroom):
    """Half of the views are bare."""
    bare = tuple(
        replace(view, image=np.full_like(view.image, 128)) if index % 2 else view
        for index, view in enumerate(showroom.views)
    )
    found = check(turned(replace(showroom, views=bare), 3.0))
    assert not found.were_off
    assert found.words.endswith("but too little holds others")


@pytest.mark.parametrize(
    ("format_", "read", "convention"),
    [
        ("transforms", lambda pose: OPENGL_TO_OPENCV @ pose, "if y and z of the cameras point the other way"),
        ("transforms", lambda pose: OPENGL_TO_OPENCV @ np.linalg.inv(pose), "if the matrices go from world to camera"),
        (
            "transforms",
            lambda pose: OPENGL_TO_OPENCV @ np.linalg.inv(OPENGL_TO_OPENCV @ pose),
            "if the matrices go from world to camera, with OpenGL's axes",
        ),
        ("colmap", np.linalg.inv, "if the poses go from camera to world"),
    ],
    ids=["opencv-axes", "world-to-camera", "world-to-camera-opengl", "colmap-camera-to-world"],
)
def test_poses_of_another_convention_are_read_as_they_were_meant(showroom, format_, read, convention):
    """`read`: what comes of right poses that were written by another convention than the format has."""
    given = replace(showroom, format=format_)
    given = given.moved({view.key: read(view.world_to_camera) for view in given.views})
    found = check(given)
    assert found.convention == convention
    assert found.words.startswith("corrected: ")
    replaced = found.replaced(given)
    for new, old in zip(replaced.views, showroom.views, strict=True):
        np.testing.assert_allclose(new.world_to_camera, old.world_to_camera, atol=1e-9)
    assert replaced.up is not None
    np.testing.assert_allclose(replaced.up.direction, showroom.up.direction)


def test_a_format_without_other_conventions_has_none(showroom):
    given = replace(showroom, format="sfm")
    given = given.moved({view.key: OPENGL_TO_OPENCV @ view.world_to_camera for view in given.views})
    assert check(given).convention == ""


def test_a_convention_is_found_without_sparse_points(showroom):
    nothing = np.zeros((0, 3))
    given = replace(showroom, points=nothing.astype(np.float32), point_colors=nothing.astype(np.uint8))
    given = given.moved({view.key: OPENGL_TO_OPENCV @ view.world_to_camera for view in given.views})
    assert check(given).convention == "if y and z of the cameras point the other way"
