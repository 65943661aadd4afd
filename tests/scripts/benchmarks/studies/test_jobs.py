"""Trials are stored and resumed, and a process that dies fails its own recipe alone."""

from __future__ import annotations

import math
import os
import signal
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch

from cvdgs.core.capture.normalised import write_capture
from cvdgs.core.enhance.gan.weights import (
    checksum_file,
    load_generator,
    load_shipped,
    save_generator,
    write_checksum,
)
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.studies.captures import CaptureFolder
from cvdgs.scripts.benchmarks.studies.jobs import (
    MATCHES_FOLDER,
    TRIALS_FILE,
    Job,
    TrialStore,
    pictures_of,
    run_jobs,
    weights_of,
)
from cvdgs.scripts.benchmarks.studies.recipe import Recipe, Trial

from .test_trials import capture_of_a_wall

SOURCE = CaptureFolder("wall", Path("nowhere"), 96)
FIRST, SECOND = Recipe("first"), Recipe("second", seed=1)
MEASURED = replace(Trial.failed("wall", FIRST, ""), psnr=30.5, ccpr=math.nan, rwe=math.inf, gaussians=7)


def same(first: Trial, second: Trial) -> bool:
    return repr(first) == repr(second)  # NaN is not equal to itself


def test_a_trial_is_read_back_as_it_was(tmp_path):
    path = tmp_path / TRIALS_FILE
    TrialStore(path).add(SOURCE, FIRST, MEASURED)
    store = TrialStore(path)
    assert same(store.trial(SOURCE, FIRST), MEASURED)
    assert store.missing(Job(SOURCE, (FIRST, SECOND))) == (SECOND,)


def test_a_trial_is_shared_by_studies_that_call_it_differently(tmp_path):
    store = TrialStore(tmp_path / TRIALS_FILE)
    store.add(SOURCE, FIRST, MEASURED)
    again = replace(FIRST, label="the default")
    assert store.missing(Job(SOURCE, (again, SECOND, replace(SECOND, label="third")))) == (SECOND,)
    assert same(store.trial(SOURCE, again), replace(MEASURED, label="the default"))
    assert pictures_of(tmp_path, SOURCE, again) == pictures_of(tmp_path, SOURCE, FIRST)


def test_pictures_of_photographs_of_another_size_have_a_folder_of_their_own(tmp_path):
    sizes = (SOURCE, replace(SOURCE, max_size=64), replace(SOURCE, fitted_size=64))
    assert len({pictures_of(tmp_path, source, FIRST) for source in sizes}) == 3


def test_of_several_jobs_that_ask_for_one_trial_the_first_makes_it(tmp_path):
    store = TrialStore(tmp_path / TRIALS_FILE)
    jobs = [Job(SOURCE, (FIRST,)), Job(SOURCE, (replace(FIRST, label="again"), SECOND)), Job(SOURCE, (SECOND,))]
    assert store.missing_of(jobs) == [Job(SOURCE, (FIRST,)), Job(SOURCE, (SECOND,))]


def test_nothing_is_used_again_that_another_product_gave(tmp_path):
    path = tmp_path / TRIALS_FILE
    TrialStore(path, product=lambda: ("steps", 5)).add(SOURCE, FIRST, MEASURED)
    assert TrialStore(path, product=lambda: ("steps", 5)).missing(Job(SOURCE, (FIRST,))) == ()
    assert TrialStore(path, product=lambda: ("steps", 6)).missing(Job(SOURCE, (FIRST,))) == (FIRST,)


@pytest.mark.parametrize(
    ("enhancer", "parameter", "counts"),
    [("cgan", "rates", False), ("cgan@0", "rates", True), ("cgan", "share.bias", True), ("cgan@0", "share.bias", True)],
)
def test_sizes_of_corrections_count_where_no_fit_follows(tmp_path, monkeypatch, enhancer, parameter, counts):
    recipe, before = Recipe("mine", enhancer=enhancer), load_shipped()
    first = weights_of(recipe)
    with torch.no_grad():
        before.get_parameter(parameter).add_(0.1)
    weights = tmp_path / "enhancer.safetensors"
    save_generator(before, weights)
    write_checksum(weights)
    monkeypatch.setattr("cvdgs.core.enhance.gan.weights.load_shipped", lambda: load_generator(weights))
    monkeypatch.setattr("cvdgs.scripts.benchmarks.provenance._WEIGHTS", checksum_file(weights))
    assert (weights_of(recipe) != first) == counts


def test_nothing_is_used_again_that_other_weights_gave(tmp_path):
    weights = tmp_path / "mine.safetensors"
    weights.write_bytes(b"first")
    recipe, store = Recipe("mine", enhancer=f"{weights}@0"), TrialStore(tmp_path / TRIALS_FILE)
    store.add(SOURCE, recipe, MEASURED)
    assert store.missing(Job(SOURCE, (recipe,))) == ()
    weights.write_bytes(b"other")
    assert store.missing(Job(SOURCE, (recipe,))) == (recipe,)


@pytest.mark.parametrize(
    "other",
    [replace(FIRST, iterations=7), replace(FIRST, seed=7), replace(FIRST, drift=7.0)],
    ids=["iterations", "seed", "drift"],
)
def test_a_recipe_that_differs_in_anything_is_tried_anew(tmp_path, other):
    store = TrialStore(tmp_path / TRIALS_FILE)
    store.add(SOURCE, FIRST, MEASURED)
    assert store.missing(Job(SOURCE, (other,))) == (other,)
    assert store.missing(Job(replace(SOURCE, max_size=95), (FIRST,))) == (FIRST,)


def test_half_a_line_at_the_end_is_forgotten_and_does_not_spoil_the_next(tmp_path):
    path = tmp_path / TRIALS_FILE
    store = TrialStore(path)
    store.add(SOURCE, FIRST, MEASURED)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[: len(whole) // 2])
    store = TrialStore(path)
    store.add(SOURCE, SECOND, MEASURED)
    assert TrialStore(path).missing(Job(SOURCE, (FIRST, SECOND))) == ()


def test_a_file_of_something_else_is_refused_in_one_line(tmp_path):
    path = tmp_path / TRIALS_FILE
    path.write_text("a table\nof something\n")
    with pytest.raises(InputError, match="line 1 is not a trial"):
        TrialStore(path)


def test_only_the_trials_that_are_to_be_repeated_are_forgotten(tmp_path):
    store, other = TrialStore(tmp_path / TRIALS_FILE), replace(SOURCE, name="other")
    for source, recipe in ((SOURCE, FIRST), (SOURCE, SECOND), (other, FIRST)):
        store.add(source, recipe, MEASURED)
    store.forget([Job(SOURCE, (FIRST,))])
    for known in (store, TrialStore(tmp_path / TRIALS_FILE)):
        assert known.missing(Job(SOURCE, (FIRST, SECOND))) == (FIRST,)
        assert known.missing(Job(other, (FIRST,))) == ()
    assert same(known.trial(other, FIRST), replace(MEASURED, capture="other"))


@dataclass(frozen=True)
class Dying(Recipe):
    """Ends the process that it is sent to."""

    def __reduce__(self):
        return os._exit, (3,)


@dataclass(frozen=True)
class Killed(Recipe):
    """Ends the process that it is sent to as the system does when memory runs out."""

    def __reduce__(self):
        return signal.raise_signal, (signal.SIGKILL,)


class Progress(Reporter):
    def __init__(self) -> None:
        self.fractions: list[float] = []

    def progress(self, stage: str, fraction: float, message: str = "") -> None:
        self.fractions.append(fraction)


def test_a_process_that_dies_and_a_capture_that_cannot_be_read_are_errors_of_their_recipes_alone(tmp_path):
    source, progress = CaptureFolder("gone", tmp_path / "gone", 96), Progress()
    died, unread = run_jobs([Job(source, (Dying("dying"), FIRST))], tmp_path / "work", progress)
    assert died.error == "the process ended with exit code 3"
    assert math.isnan(died.psnr)
    assert unread.error.startswith("InputError: ")
    assert progress.fractions == [0.0, 0.5, 1.0]


def test_a_trial_whose_process_was_killed_is_tried_again_when_the_study_goes_on(tmp_path):
    job = Job(CaptureFolder("gone", tmp_path / "gone", 96), (Killed("killed"), FIRST))
    killed, unread = run_jobs([job], tmp_path / "work", Reporter())
    assert killed.error == "the process ended with exit code -9"
    assert unread.error.startswith("InputError: ")
    assert TrialStore(tmp_path / "work" / TRIALS_FILE).missing(job) == job.recipes[:1]


@dataclass(frozen=True)
class Interrupting(CaptureFolder):
    """Where a trial reads it, somebody types Ctrl-C, which reaches every process of the group."""

    def load(self):
        begun = self.folder.with_suffix(".begun")
        if begun.exists():  # the first to read it looks for matches
            os.kill(os.getppid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(20.0)
        begun.touch()
        raise InputError("no more than an example")


@pytest.fixture
def interruptible():
    """As in a terminal: what a shell starts in the background ignores Ctrl-C, and so does what that starts."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_ends_a_study_and_the_trial_that_it_interrupts_is_not_stored(tmp_path):
    interrupting, later = (Interrupting(name, tmp_path / name, 96) for name in ("interrupting", "later"))
    with pytest.raises(KeyboardInterrupt):
        run_jobs([Job(interrupting, (FIRST, SECOND)), Job(later, (FIRST,))], tmp_path / "work", Reporter())
    assert not (tmp_path / "work" / TRIALS_FILE).exists()
    assert not (tmp_path / "later.begun").exists()


@pytest.mark.slow
def test_what_was_tried_is_not_tried_again(tmp_path):
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    source = CaptureFolder("wall", tmp_path / "wall", 96)
    bad, good = Dying("bad", iterations=20), Recipe("good", enhancer="none", iterations=20, gaussians=400)
    first = run_jobs([Job(source, (bad, good))], tmp_path / "work", Reporter())
    assert first[1].error == ""
    assert first[1].psnr > 10.0
    assert (pictures_of(tmp_path / "work", source, good) / "renders" / "original").is_dir()
    progress = Progress()
    second = run_jobs([Job(source, (bad, good))], tmp_path / "work", progress)
    assert all(same(*pair) for pair in zip(first, second, strict=True))
    assert progress.fractions == []


@dataclass(frozen=True)
class Watched(CaptureFolder):
    """Notes which processes read it, and whether its matches are known by then."""

    log: Path = Path()

    def load(self):
        known = any((self.log.parent / MATCHES_FOLDER).glob("*.npz"))
        with open(self.log, "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()} {known}\n")
        return super().load()


@pytest.mark.slow
def test_the_memory_of_a_trial_does_not_contain_the_search_for_matches(tmp_path):
    write_capture(capture_of_a_wall(), tmp_path / "wall")
    source = Watched("wall", tmp_path / "wall", 96, log=tmp_path / "log")
    run_jobs([Job(source, (Recipe("any", enhancer="none", iterations=20, gaussians=400),))], tmp_path, Reporter())
    (finding, _), (trying, known) = [line.split() for line in source.log.read_text().splitlines()]
    assert finding != trying
    assert known == "True"
