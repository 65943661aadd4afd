"""What some photographs show and others do not is left out of training; where nothing moves, nothing changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cvdgs.core.capture.model import View
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.demo import SHOWROOM
from cvdgs.core.errors import InputError
from cvdgs.core.files.states import SavedState, read_state, write_state
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.motion_blur import smeared_array
from cvdgs.core.splats.gaussians import Gaussians
from cvdgs.core.splats.raster import ParameterSet, Rasterizer
from cvdgs.core.splats.renderer import SceneRenderer
from cvdgs.core.splats.scene_frame import SceneFrame
from cvdgs.core.splats.targets import prepare_targets
from cvdgs.core.splats.training.moving import MovingThings, find_moving
from cvdgs.core.splats.training.plan import MovingPlan, TrainingPlan, TrainingResult
from cvdgs.core.splats.training.trainer import Trainer
from cvdgs.core.splats.training.validation import Validation

from .test_masked_training import BLACK, HEIGHT, WIDTH, photographs, scene

SIDE = 26  # pixels of what moves
STEPS = 400
PLAN = MovingPlan(outlying=12.0)  # this small scene is fitted less closely than photographs usually are


def visited(views: Sequence[View], every: int = 3) -> tuple[list[View], dict[str, np.ndarray]]:
    """The photographs, a third of them with something striped anywhere in it, and where."""
    result, places = [], {}
    stripes = np.where((np.arange(SIDE) // 4 % 2)[:, None, None], (230, 20, 220), (20, 10, 40)).astype(np.uint8)
    for index, view in enumerate(views):
        if index % every == 0:
            rng = np.random.default_rng(index)
            top, left = rng.integers(0, HEIGHT - SIDE), rng.integers(0, WIDTH - SIDE)
            image, place = view.image.copy(), np.zeros((HEIGHT, WIDTH), bool)
            image[top : top + SIDE, left : left + SIDE] = stripes
            place[top : top + SIDE, left : left + SIDE] = True
            view, places[view.key] = replace(view, image=image), place
        result.append(view)
    return result, places


@pytest.fixture(scope="module")
def gaussians() -> Gaussians:
    return scene()


@pytest.fixture(scope="module")
def clean(gaussians: Gaussians) -> list[View]:
    return photographs(gaussians, 30)


def parts(clean: Sequence[View]) -> tuple[list[View], list[View]]:
    """Views to train on, and to judge by."""
    return [view for index, view in enumerate(clean) if index % 5], list(clean[::5])


def trained(
    training: Sequence[View], judging: Sequence[View], gaussians: Gaussians, moving: MovingPlan | None
) -> tuple[TrainingResult, float]:
    """A scene, and its dB on clean photographs that it was not fitted to."""
    points = gaussians.means + np.random.default_rng(1).normal(0, 0.03, gaussians.means.shape).astype(np.float32)
    colors = np.full((len(points), 3), 128, np.uint8)
    plan = TrainingPlan(steps=STEPS, limit=600, sh_degree=0, moving=moving)
    result = Trainer(Rasterizer("cpu"), training, judging, points, colors, plan, BLACK, 0).train(Reporter())
    renderer = SceneRenderer(Rasterizer("cpu"), judging, BLACK)
    pictures = [renderer.color(result.gaussians, index) for index in range(len(judging))]
    return result, float(np.mean([renderer.fidelity(index, picture)["psnr"] for index, picture in enumerate(pictures)]))


def test_what_moves_is_found_and_the_scene_gains_by_leaving_it_out(gaussians: Gaussians, clean: list[View]) -> None:
    training, judging = parts(clean)
    moving, places = visited(training)
    _, spoilt = trained(moving, judging, gaussians, None)
    result, psnr = trained(moving, judging, gaussians, PLAN)
    assert psnr > spoilt + 0.3
    assert result.moving.keys() == places.keys()
    hit = sum(int((result.moving[key] & place).sum()) for key, place in places.items())
    assert hit > 0.9 * sum(int(place.sum()) for place in places.values())
    assert hit > 0.7 * sum(int(region.sum()) for region in result.moving.values())  # with a margin around
    assert result.decision["moving"].startswith("left out")


@pytest.mark.slow
def test_where_nothing_moves_the_scene_is_the_same_bit_by_bit(gaussians: Gaussians, clean: list[View]) -> None:
    training, judging = parts(clean)
    without, with_plan = (trained(training, judging, gaussians, plan)[0] for plan in (None, PLAN))
    for name, values in vars(without.gaussians).items():
        assert np.array_equal(values, getattr(with_plan.gaussians, name)), name
    assert without.decision == with_plan.decision
    assert with_plan.moving == {}


def targets_of(views: Sequence[View], gaussians: Gaussians):
    frame = SceneFrame.around(views, np.zeros((0, 3), np.float32))
    rasterizer = Rasterizer("cpu")
    parameters = ParameterSet.from_gaussians(frame.from_world(gaussians), rasterizer.device)
    return rasterizer, parameters, prepare_targets(rasterizer, views, frame, BLACK, {2})


def test_what_the_scene_lacks_in_all_views_is_not_taken_for_something_that_moves(
    gaussians: Gaussians, clean: list[View]
) -> None:
    """Other views have to witness: a hole in the scene is one in all of them."""
    holed = replace(gaussians, sh=gaussians.sh.copy())
    near = np.linalg.norm(gaussians.means[:, :2], axis=1) < 0.5
    holed.sh[near] = -holed.sh[near]
    rasterizer, parameters, targets = targets_of(clean, holed)
    assert find_moving(rasterizer, parameters, targets, BLACK, PLAN) == {}
    moving, places = visited(clean)
    rasterizer, parameters, targets = targets_of(moving, gaussians)
    assert find_moving(rasterizer, parameters, targets, BLACK, PLAN).keys() == {
        index for index, view in enumerate(moving) if view.key in places
    }


def test_what_was_smeared_while_it_was_photographed_does_not_move(gaussians: Gaussians, clean: list[View]) -> None:
    line = np.array([9.0, 0.0])
    smeared = [
        replace(view, image=np.round(smeared_array(view.image.astype(np.float32), line)).astype(np.uint8), smear=line)
        if index % 3 == 0
        else view
        for index, view in enumerate(clean)
    ]
    rasterizer, parameters, targets = targets_of(smeared, gaussians)
    wary = MovingPlan(outlying=4.0, belonging=2.0)
    assert find_moving(rasterizer, parameters, targets, BLACK, wary) == {}
    unknown = [replace(target, smear=None) for target in targets]
    assert find_moving(rasterizer, parameters, unknown, BLACK, wary)


def test_what_was_found_is_kept_in_a_checkpoint_and_a_damaged_one_is_refused(
    gaussians: Gaussians, clean: list[View], tmp_path: Path
) -> None:
    rasterizer, _, targets = targets_of(clean, gaussians)

    def things() -> MovingThings:
        judging = Validation(targets[25:], lambda _: pytest.fail("nothing is aligned"))
        return MovingThings(rasterizer, BLACK, TrainingPlan(), list(targets), 25, judging)

    def restored(state: dict) -> MovingThings:
        write_state(tmp_path / "state", {"moving": state}, {})
        saved: SavedState = read_state(tmp_path / "state", "it", "again", most_bytes=1 << 20)[1]
        again = things()
        again.restore(saved.part("moving"))
        return again

    first = things()
    region = np.zeros((HEIGHT, WIDTH), bool)
    region[10:20, 10:30] = True
    first.regions[3] = region
    again = restored(dict(first.snapshot()))
    assert np.array_equal(again.of_targets([view.key for view in clean])[clean[3].key], region)
    assert np.array_equal(again._targets[3].looked_at(), ~region)
    for damage in ({"views": [40]}, {"views": [4]}, {"regions": {"3": region[1:]}}, {"looks": 99}):
        with pytest.raises(InputError, match="damaged"):
            restored({**first.snapshot(), **damage})


def walker(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A photograph with a striped figure somewhere in it, half as high as the picture."""
    height, width = image.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    size = height * rng.uniform(0.45, 0.65)
    across = (columns - rng.uniform(0.2, 0.8) * width) / size
    down = (rows - rng.uniform(0.45, 0.6) * height) / size
    result = image.copy()
    result[(across / 0.09) ** 2 + ((down + 0.4) / 0.11) ** 2 < 1.0] = (205, 160, 130)
    body = (np.abs(across) < 0.16) & (down > -0.3) & (down < 0.15)
    stripes = np.where((np.sin(40.0 * down) > 0.0)[..., None], (150, 30, 40), (225, 220, 210))
    result[body] = stripes[body].astype(np.uint8)
    result[(np.abs(np.abs(across) - 0.08) < 0.06) & (down >= 0.15) & (down < 0.5)] = (40, 50, 90)
    return result


@pytest.mark.slow
def test_the_demo_with_somebody_walking_through_a_third_of_it_gains_by_leaving_that_out() -> None:
    """On held-out photographs without anybody; in the demo alone, nothing is found."""
    capture = read_capture(SHOWROOM, max_size=240)
    judging, training, rng = list(capture.views[4::8]), [], np.random.default_rng(3)
    for index, view in enumerate(capture.views):
        if index % 8 != 4:
            training.append(view if index % 3 != 1 else replace(view, image=walker(view.image, rng)))

    def fitted(views: Sequence[View], moving: MovingPlan | None) -> TrainingResult:
        plan = TrainingPlan(steps=700, moving=moving)
        points = capture.points, capture.point_colors
        return Trainer(Rasterizer("cpu"), views, judging, *points, plan, BLACK, 0).train(Reporter())

    spoilt, mended = (fitted(training, moving) for moving in (None, MovingPlan()))
    assert mended.curve[-1]["psnr"] > spoilt.curve[-1]["psnr"] + 0.1
    assert len(mended.moving) >= 8
    still = [view for index, view in enumerate(capture.views) if index % 8 != 4]
    assert fitted(still, MovingPlan()).moving == {}
