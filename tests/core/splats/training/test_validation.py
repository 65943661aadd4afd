"""Views that decide: how they are measured, and what a checkpoint keeps of them."""

from dataclasses import replace

import numpy as np
import pytest

from cvdgs.core.files.states import read_state, write_state
from cvdgs.core.splats.calibration.motion_blur import smeared_array
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import prepare_targets
from cvdgs.core.splats.training.checkpoints import fingerprint
from cvdgs.core.splats.training.fitting import Fit
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.validation import Validation

from .test_trainer import BLACK, photographs, wall

LINE = np.array([7.0, 3.0])


@pytest.fixture(scope="module")
def scene():
    return wall(200)


@pytest.fixture(scope="module")
def views(scene):
    return photographs(scene, 4)


def prepared(scene, views):
    """A finished fit of `scene`, and the targets of `views`."""
    frame, rasterizer = SceneFrame.around(views, scene.means), Rasterizer("cpu")
    return Fit(rasterizer, frame.from_world(scene), BLACK, 0.2), prepare_targets(rasterizer, views, frame, BLACK)


def blurred(view, line=LINE):
    image = smeared_array(view.image.astype(np.float32), line)
    return replace(view, image=np.round(image).astype(np.uint8))


def masked(view, shown: int):
    """The view of which the left `shown` columns are looked at."""
    mask = np.zeros(view.image.shape[:2], bool)
    mask[:, :shown] = True
    return replace(view, mask=mask)


def nothing_to_align(_):
    pytest.fail("nothing is aligned")


def test_lines_of_motion_blur_are_kept_in_a_checkpoint(scene, views, tmp_path):
    fit, targets = prepared(scene, [*map(blurred, views[:2]), *views[2:]])
    before = Validation(targets, nothing_to_align)
    before.views = [*fit.smeared(targets[:2]), *targets[2:]]
    write_state(tmp_path / "state", {"validation": before.snapshot()}, {})
    after = Validation(targets, nothing_to_align)
    after.restore(read_state(tmp_path / "state", "it", "again", most_bytes=1 << 20)[1].part("validation"))
    for view, restored in zip(before.views, after.views, strict=True):
        np.testing.assert_array_equal(restored.smear, view.smear)
    assert fit.psnr(after.views) == fit.psnr(before.views) > fit.psnr(targets) + 3.0


def test_a_view_of_which_something_moves_keeps_its_line(scene, views):
    _, (target,) = prepared(scene, [replace(views[0], smear=LINE)])
    region = np.zeros(views[0].image.shape[:2], bool)
    region[:20] = True
    np.testing.assert_array_equal(target.without(region).smear, LINE)


def test_a_line_is_sought_again_where_none_was_found_before(scene, views):
    fit, (target,) = prepared(scene, [blurred(views[0])])
    found = fit.best_line(replace(target, smear=np.zeros(2)))
    assert min(np.linalg.norm(found - LINE), np.linalg.norm(found + LINE)) < 2.0


def test_views_of_which_nothing_is_looked_at_say_nothing(scene, views):
    fit, (whole, half, hidden) = prepared(scene, [views[0], masked(views[1], 40), masked(views[2], 0)])
    assert fit.psnr([whole, hidden, half]) == pytest.approx(fit.psnr([whole, half]))
    assert fit.psnr([hidden], any_exposure=True) == 0.0


def test_a_checkpoint_is_of_photographs_with_these_lines(scene, views):
    colors = np.zeros((len(scene), 3), np.uint8)
    given, other = (
        fingerprint(TrainingPlan(), 0, [replace(views[0], smear=smear)], [], scene.means, colors)
        for smear in (None, LINE)
    )
    assert given != other
