"""A run that was broken off goes on from its checkpoint as if nothing had happened."""

import json
import os
import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from cvdgs.core.errors import Cancelled, InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.splats.calibration.exposure import ExposurePlan
from cvdgs.core.splats.calibration.poses import PosePlan
from cvdgs.core.splats.raster import Rasterizer
from cvdgs.core.splats.training.checkpoints import Checkpoints
from cvdgs.core.splats.training.decisions import GrowthRule, ShDegreeRule, StopRule
from cvdgs.core.splats.training.plan import TrainingPlan
from cvdgs.core.splats.training.trainer import Trainer

from .test_trainer import BLACK, photographs, wall

STEPS = 120
# All that a run can decide is decided in it: growth, exposures, poses, the SH degree, the end of validation, contrast.
PLAN = TrainingPlan(
    steps=STEPS,
    sh_degree=None,
    growth=GrowthRule(fewest=1200),
    stopping=StopRule(patience=1.0),
    sh_degree_rule=ShDegreeRule(steps=0.05, fewest_steps=6, degree_gain=-9.0, highest=1),
    exposure=ExposurePlan(decided_at=0.3, trial=0.05, fewest_trial_steps=6, least_gain=-9.0),
    poses=PosePlan(
        checks=((0.2, 0.0),),
        least_steps=1,
        probe_steps=2,
        align_steps=3,
        follow_steps=1,
        trial=0.05,
        fewest_trial_steps=6,
        least_gain=-9.0,
    ),
)
PLACES = {"coarse": 10, "growth": 50, "corrected": 70, "thinned": 90, "contrast": 100, "all-fitted": 110}


class Broken(BaseException):
    """In the place of a power cut."""


class BreaksOff(Reporter):
    """Ends the run in a step, before the checkpoint after it."""

    def __init__(self, step: int) -> None:
        self.share = step / STEPS

    def progress(self, stage, fraction, message=""):
        if fraction >= self.share:
            raise Broken


@pytest.fixture(scope="module")
def scene():
    return wall(300)


@pytest.fixture(scope="module")
def views(scene):
    """Enough of them to validate on some, large enough for a coarse stage, and of different exposure."""
    given = photographs(scene, count=26, size=(128, 100))
    gains = np.random.default_rng(5).uniform(0.7, 1.0, len(given))
    return [replace(v, image=(v.image * gain).astype(np.uint8)) for v, gain in zip(given, gains, strict=True)]


@pytest.fixture
def said():
    return []


@pytest.fixture
def trainer(scene, views, tmp_path, said):
    """Makes a trainer whose checkpoints are in a folder of this test."""

    def make(resume: bool, **others) -> Trainer:
        return make_trainer(scene, views, tmp_path / "kept", said, resume, **others)

    return make


def make_trainer(scene, views, folder, said, resume, plan=PLAN, seed=0, seconds=0.0) -> Trainer:
    kept = Checkpoints(folder, {"version": "1"}, resume=resume, warn=said.append, every_seconds=seconds)
    colors = np.full((len(scene), 3), 128, np.uint8)
    return Trainer(Rasterizer("cpu"), views[1:], views[:1], scene.means, colors, plan, BLACK, seed, kept)


@pytest.fixture(scope="module")
def uninterrupted(scene, views):
    colors = np.full((len(scene), 3), 128, np.uint8)
    return Trainer(Rasterizer("cpu"), views[1:], views[:1], scene.means, colors, PLAN, BLACK, 0).train(Reporter())


def break_off(trainer, step: int) -> None:
    with pytest.raises(Broken):
        trainer.train(BreaksOff(step))


def assert_same(found, expected) -> None:
    for name, value in vars(expected.gaussians).items():
        np.testing.assert_array_equal(getattr(found.gaussians, name), value, err_msg=name)
    assert found.moved_poses.keys() == expected.moved_poses.keys()
    for key, pose in expected.moved_poses.items():
        np.testing.assert_array_equal(found.moved_poses[key], pose)
    assert found.decision == expected.decision
    timeless = [[{**entry, "seconds": 0.0} for entry in result.curve] for result in (found, expected)]
    assert timeless[0] == timeless[1]
    assert (found.initial, found.skipped) == (expected.initial, expected.skipped)


def test_the_run_of_these_tests_decides_everything(uninterrupted):
    decision = uninterrupted.decision
    assert decision["exposure"].startswith("corrected")
    assert decision["poses"].startswith("corrected")
    assert decision["sh_degree"].startswith("1: degree 1 gained")
    assert "then fitted like the others" in decision["views"]
    assert len(uninterrupted.gaussians) > uninterrupted.initial


@pytest.mark.parametrize("step", PLACES.values(), ids=PLACES.keys())
def test_a_run_that_was_broken_off_ends_with_the_same_bits(trainer, uninterrupted, step):
    break_off(trainer(resume=False), step)
    assert_same(trainer(resume=True).train(Reporter()), uninterrupted)


def test_a_run_that_ends_early_may_be_broken_off_in_its_last_part(trainer, scene, views):
    plan = replace(PLAN, stopping=StopRule(patience=0.1, min_gain=9.0), short_run=0)
    colors = np.full((len(scene), 3), 128, np.uint8)
    whole = Trainer(Rasterizer("cpu"), views[1:], views[:1], scene.means, colors, plan, BLACK, 0).train(Reporter())
    ended = whole.curve[-1]["step"]
    assert ended < STEPS
    kept = trainer(resume=False, plan=plan)
    with pytest.raises(Broken):
        kept.train(BreaksOff((ended - 10) * STEPS // ended))
    assert_same(trainer(resume=True, plan=plan).train(Reporter()), whole)


def test_so_does_one_that_leaves_gaussians_out_of_its_steps(scene, tmp_path, said):
    few, plan = photographs(scene, count=3), TrainingPlan(steps=400, sh_degree=0, contrast=None)
    whole = make_trainer(scene, few, tmp_path / "none", said, False, plan).train(Reporter())
    assert "dropout" in whole.decision
    break_off(make_trainer(scene, few, tmp_path / "kept", said, False, plan), STEPS // 2)
    assert_same(make_trainer(scene, few, tmp_path / "kept", said, True, plan).train(Reporter()), whole)


def test_a_run_may_be_broken_off_again_and_again(trainer, uninterrupted):
    for number, step in enumerate((30, 60, 110)):
        break_off(trainer(resume=number > 0), step)
    assert_same(trainer(resume=True).train(Reporter()), uninterrupted)


def test_a_run_that_ended_before_its_time_is_not_trained_further(trainer, tmp_path, uninterrupted):
    trainer(resume=False).train(Reporter())  # what follows the training may be broken off, too
    assert_same(trainer(resume=True).train(BreaksOffNever()), uninterrupted)


class BreaksOffNever(Reporter):
    def progress(self, stage, fraction, message=""):
        assert fraction == 1.0, "a step was made"


def test_without_being_asked_to_a_run_starts_anew(trainer, uninterrupted):
    break_off(trainer(resume=False), 30)
    again = trainer(resume=False)
    assert again._step == 0
    assert_same(again.train(Reporter()), uninterrupted)


@pytest.mark.parametrize("other", [{"seed": 1}, {"plan": replace(PLAN, ssim_weight=0.3)}], ids=["seed", "plan"])
def test_a_checkpoint_of_another_run_is_not_used_and_that_is_said(trainer, said, other):
    break_off(trainer(resume=False), 10)
    assert trainer(resume=True, **other)._step == 0
    assert said == ["the checkpoint is of other photographs, cameras or settings; the run starts anew"]


def test_a_checkpoint_of_other_photographs_is_not_used(trainer, views, said):
    break_off(trainer(resume=False), 10)
    views[3].image[5, 5, 1] ^= 1
    try:
        assert trainer(resume=True)._step == 0
    finally:
        views[3].image[5, 5, 1] ^= 1
    assert len(said) == 1


def test_a_cancelled_run_leaves_a_checkpoint_of_its_last_whole_step(trainer, tmp_path, uninterrupted):
    class Cancels(Reporter):
        def progress(self, stage, fraction, message=""):
            os.kill(os.getpid(), signal.SIGINT)

    def handler(number, frame):
        raise AssertionError("in the middle of a step")

    before = signal.signal(signal.SIGINT, handler)
    try:
        with pytest.raises(Cancelled):
            trainer(resume=False).train(Cancels())
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)
    again = trainer(resume=True)
    assert again._step == 10
    assert_same(again.train(Reporter()), uninterrupted)


def test_a_short_run_leaves_nothing(trainer, tmp_path):
    break_off(trainer(resume=False, seconds=1000.0), 50)
    trainer(resume=False, seconds=1000.0).train(Reporter())
    assert not (tmp_path / "kept").exists()


def test_a_checkpoint_that_cannot_be_written_ends_no_run(trainer, tmp_path, said, uninterrupted):
    (tmp_path / "kept").write_text("a file where the folder should be")
    assert_same(trainer(resume=False).train(Reporter()), uninterrupted)
    assert "no checkpoint could be written" in said[0]


@pytest.fixture(scope="module")
def broken_off(scene, views, tmp_path_factory):
    """The folder of a run that was broken off near its end."""
    folder = tmp_path_factory.mktemp("broken") / "kept"
    break_off(make_trainer(scene, views, folder, [], resume=False), 110)
    return folder


@pytest.fixture
def kept(broken_off, tmp_path):
    """A checkpoint, and how to change it."""
    path = shutil.copytree(broken_off, tmp_path / "kept") / "state.safetensors"

    def change(arrays=lambda arrays: None, values=lambda values: None):
        tensors = load_file(path)
        with safe_open(path, framework="np") as file:
            metadata = file.metadata()
        content = json.loads(metadata["values"])
        arrays(tensors)
        values(content)
        save_file(tensors, path, {**metadata, "values": json.dumps(content)})

    return path, change


def set_at(*names, value):
    """Changes a value within values."""

    def change(values):
        for name in names[:-1]:
            values = values[name]
        values[names[-1]] = value

    return change


DAMAGED = {
    "missing-array": {"arrays": lambda a: a.pop("fit.parameters.means")},
    "short-array": {"arrays": lambda a: a.update({"fit.parameters.sh": a["fit.parameters.sh"][:-1]})},
    "other-type": {"arrays": lambda a: a.update({"fit.adam.steps": a["fit.adam.steps"].astype(np.int64)})},
    "negative-steps": {"arrays": lambda a: a.update({"fit.adam.steps": -a["fit.adam.steps"] - 1})},
    "huge": {"values": set_at("fit", "gaussians", value=10**12)},
    "odd-degree": {"values": set_at("fit", "sh_count", value=5)},
    "late-step": {"values": set_at("step", value=STEPS + 1)},
    "other-view": {"values": set_at("order", "left", value=[0, 99])},
    "random": {"values": set_at("random", value={"bit_generator": "MT19937"})},
    "random-number": {"values": set_at("random", "state", "inc", value=2**200)},
    "measurement": {"values": set_at("log", "rounds", value=[[1, 2, "x", 3]])},
    "curve": {"values": set_at("curve", "entries", value=[{"step": 1}])},
    "empty-curve": {"values": set_at("curve", "entries", value=[])},
    "part": {"values": set_at("corrections", value=[])},
    "nothing": {"values": lambda v: v.clear()},
}


@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED.keys())
def test_a_damaged_checkpoint_is_refused_in_one_line(trainer, kept, damage):
    path, change = kept
    change(**damage)
    with pytest.raises(InputError) as refusal:
        trainer(resume=True)
    assert str(refusal.value).startswith(f"{path}: the checkpoint is damaged (")
    assert str(refusal.value).endswith(" - run again without --resume")


@pytest.mark.parametrize("content", [b"", b"\x08\x00\x00\x00\x00\x00\x00\x00{}      ", b"pickle" * 50])
def test_what_is_no_checkpoint_is_refused(trainer, kept, content):
    path, _ = kept
    path.write_bytes(content)
    with pytest.raises(InputError, match="run again without --resume"):
        trainer(resume=True)


def test_a_checkpoint_that_was_cut_off_is_refused(trainer, kept):
    path, _ = kept
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(InputError, match="cannot be read"):
        trainer(resume=True)
