"""Automatic decisions: how many Gaussians, steps and SH degrees a scene needs, by views held back for validation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from ...files.states import SavedState, State
from ..gaussians import Gaussians
from ..raster import LearningRates, ParameterSet
from .fitting import Fit

MANY_VIEWS = 24
"""Training views from which some can be spared for validation."""
FEW_VIEWS = 8
"""Training views from which one can be spared for validation if no view is held out."""
_MOST_VALIDATION = 6
_ONE_IN = 18  # on the demo, validating on two of 35 views to the end cost 0.3 dB
_SMALL_SCENE = 10_000  # Gaussians, up to which `_SMALL_SCENE_PIXELS` of the training views are enough for each
_SMALL_SCENE_PIXELS = 50  # with 25, scenes of few photographs overfitted by up to 2.4 dB
_LEAST_DOUBLINGS = 0.1  # of the number of Gaussians, for a gain to be ascribed to it
# A few validation views scatter by this much from one measurement to the next; a smaller loss is no reason to go back.
_WORTH_RESTORING = 0.15  # dB


@dataclass(frozen=True)
class ViewSplit:
    """Which training views are fitted and which views validate.

    Attributes:
        fitted: indices into the training views.
        validation: indices into the training views, of those that are not fitted.
        validate_on_held_out: whether the held-out views, on which the run will be evaluated, validate as well.
        reason: all this in plain words, for the report.
    """

    fitted: list[int]
    validation: list[int]
    validate_on_held_out: bool
    reason: str


def split_views(training: int, held_out: int, *, decides: bool = True) -> ViewSplit:
    """The split of a capture: training views validate if there are enough of them, else the held-out ones.

    Args:
        training, held_out: numbers of views.
        decides: whether the run has anything to decide; if not, all views are fitted.
    """
    everything = list(range(training))
    if not decides:
        return ViewSplit(everything, [], False, "no validation: there was nothing to decide")
    if training >= MANY_VIEWS or (not held_out and training >= FEW_VIEWS):
        count = min(max(training // _ONE_IN, 1), _MOST_VALIDATION)
        validation = sorted({int((i + 0.5) * training / count) for i in range(count)})
        fitted = [i for i in everything if i not in validation]
        return ViewSplit(fitted, validation, False, f"{count} of {training} training views held back for validation")
    if held_out:
        return ViewSplit(
            everything,
            [],
            True,
            f"validated on the held-out views, because {training} training views are too few to hold some back: "
            "figures on them are slightly optimistic",
        )
    return ViewSplit(everything, [], False, f"no validation: {training} views are too few to hold one back")


class Measurement(NamedTuple):
    """PSNR (dB) of the validation views after `step` steps, with this number of Gaussians.

    `work` counts the tile intersections so far, a hardware-independent cost proxy: unlike time it is the same whenever
    a run is repeated, so the same seed gives the same decisions.
    """

    step: int
    gaussians: int
    psnr: float
    work: int


class GrowthTrial(NamedTuple):
    """What validation views gained by each doubling of the Gaussians in a trial: PSNR in dB, and CCPR."""

    psnr: float
    contrast: float

    @property
    def words(self) -> str:
        """For the report."""
        return f"{self.psnr:.2f} dB and {self.contrast:.3f} of the contrast in a trial"


@dataclass(frozen=True)
class GrowthRule:
    """When there are enough Gaussians.

    PSNR hardly sees weak contrast. So when it says that there are enough, a trial asks what the next ones add: two
    branches from the same scene, one with them.

    Attributes:
        doubling_gain: dB that a doubling of their number has to gain. Around their knee, peers gain 0.25 to 0.35 dB
            by one (FastGS 0.4 to 1.15 million, gsplat 1 to 2 million); more is required here, since it includes what
            training alone gains meanwhile.
        work_gain: dB that a doubling of all the work so far has to gain.
        contrast_gain: CCPR for normal vision that a doubling has to gain in a trial if it gains fewer dB. A scene gains
            about 0.016 along with 0.4 dB; branches of a trial differ by 0.002 for no reason, 0.005 for a doubling.
        bearable_loss: dB that a doubling may lose there at most: where PSNR falls farther, much of what is gained
            is noise, which counts as contrast, too.
        trial: share of the run's steps in either branch, at least `fewest_trial_steps`; none is made in runs of which
            that would be more than `largest_trial`.
        window: rounds over which a gain is measured, so that one noisy measurement does not decide.
        pixels_per_gaussian: of the training views, at least; limits the number of Gaussians. Scenes of few or
            small photographs may have more.
        fewest: lower bound of that limit.
    """

    doubling_gain: float = 0.4
    work_gain: float = 0.4
    contrast_gain: float = 0.01
    bearable_loss: float = 0.2
    trial: float = 0.05
    fewest_trial_steps: int = 60
    largest_trial: float = 0.1
    window: int = 2
    pixels_per_gaussian: int = 100
    fewest: int = 1000

    def ceiling(self, pixels: int) -> int:
        """Most Gaussians that this number of pixels can determine."""
        small = min(pixels // _SMALL_SCENE_PIXELS, _SMALL_SCENE)
        return max(pixels // self.pixels_per_gaussian, small, self.fewest)

    def verdict(self, rounds: Sequence[Measurement]) -> str | None:
        """Why the last `window` rounds show that there are enough; None while growth pays."""
        if len(rounds) <= self.window:
            return None
        before, now = rounds[-1 - self.window], rounds[-1]
        gain = now.psnr - before.psnr
        doublings = math.log2(now.gaussians / before.gaussians)
        if doublings > _LEAST_DOUBLINGS and gain < self.doubling_gain * doublings:
            return f"doubling them gained {gain / doublings:.2f} dB, less than {self.doubling_gain:g}"
        doublings = math.log2(now.work / max(before.work, 1))
        if gain < self.work_gain * doublings:
            return f"doubling the time gained {gain / doublings:.2f} dB, less than {self.work_gain:g}"
        return None

    def trial_steps(self, steps: int) -> int:
        """Steps of each branch of a trial in a run of `steps`; 0 if the run is too short for one."""
        trial = max(round(self.trial * steps), self.fewest_trial_steps)
        return trial if trial <= self.largest_trial * steps else 0

    def tells(self, before: int, after: int) -> bool:
        """Whether growing from `before` to `after` Gaussians is enough for a trial to tell."""
        return math.log2(after / before) > _LEAST_DOUBLINGS

    def pays(self, gained: GrowthTrial) -> bool:
        """Whether the Gaussians that a trial added are worth it, by PSNR or by contrast."""
        enough_contrast = gained.contrast >= self.contrast_gain and gained.psnr >= -self.bearable_loss
        return gained.psnr >= self.doubling_gain or enough_contrast


@dataclass(frozen=True)
class StopRule:
    """Early stopping.

    Attributes:
        every: share of the run between two measurements.
        patience: share of the run without a new best after which it ends.
        min_gain: dB that make a new best.
    """

    every: float = 0.025
    patience: float = 0.25
    min_gain: float = 0.02

    def due(self, step: int, steps: int) -> bool:
        """Whether to measure after `step` of `steps`."""
        return step % max(round(self.every * steps), 1) == 0

    def should_stop(self, measured: Sequence[Measurement], steps: int) -> bool:
        """Whether `patience` has run out."""
        best, last_gain = -math.inf, 0
        for measurement in measured:
            if measurement.psnr > best + self.min_gain:
                best, last_gain = measurement.psnr, measurement.step
        return bool(measured) and measured[-1].step - last_gain >= self.patience * steps


@dataclass(frozen=True)
class ShDegreeRule:
    """When a higher degree of spherical harmonics pays, by trials of the colours near the end of a run.

    Attributes:
        highest: degree that is tried.
        steps: of a trial, as a share of the run's steps; at least `fewest_steps`.
        largest_share: of the run's steps; if a trial would take more, none is made. Such a run has not settled, and a
            higher degree would make up for that: a matte scene was given degree 2 after 450 steps.
        degree_gain: dB that a degree has to gain: it makes every Gaussian larger by half and more.
        sh0_learning_rate, sh_rest_learning_rate: of the degree-0 and the higher coefficients at the start of a trial.
        lr_final_factor: factor of the learning rates at its end.
    """

    highest: int = 3
    steps: float = 0.04
    fewest_steps: int = 120
    largest_share: float = 0.1
    degree_gain: float = 0.25
    sh0_learning_rate: float = 2e-3
    sh_rest_learning_rate: float = 1e-2
    lr_final_factor: float = 0.1

    def trial_steps(self, steps: int) -> int:
        """Steps of a trial in a run of `steps`; 0 if the run is too short for one."""
        trial = max(round(self.steps * steps), self.fewest_steps)
        return trial if trial <= self.largest_share * steps else 0

    def learning_rates(self, progress: float) -> LearningRates:
        """Learning rates of a trial: of the colours alone, so that its gain is due to them."""
        factor = self.lr_final_factor**progress
        return LearningRates(sh0=self.sh0_learning_rate * factor, sh_rest=self.sh_rest_learning_rate * factor)


def _measurement(saved: SavedState, entry: Any) -> Measurement:
    if not isinstance(entry, list) or [type(value) for value in entry] != [int, int, float, int]:
        saved.refuse("a measurement is unusable")
    return Measurement(*entry)


@dataclass
class DecisionLog:
    """The measurements and decisions of a run, and its best Gaussians so far.

    Attributes:
        views: which views validate, in plain words.
        strategy: its name.
        steps: planned.
        limit: of the number of Gaussians as asked for, or None.
        initial: number of Gaussians at the start.
        start: what was chosen to start from, in plain words; empty if there was nothing to choose.
        measured: on the validation views, at regular steps.
        rounds: likewise, before each refinement.
        growth, degree: verdicts in plain words, empty if there is none.
        stopped: whether it stopped early.
    """

    views: str
    strategy: str
    steps: int
    limit: int | None
    initial: int = 0
    start: str = ""
    measured: list[Measurement] = field(default_factory=list)
    rounds: list[Measurement] = field(default_factory=list)
    growth: str = ""
    degree: str = ""
    stopped: bool = False
    _best: tuple[Measurement, Gaussians] | None = None
    _restored: str = ""

    def snapshot(self) -> State:
        """What `restore` continues from."""
        state: dict[str, Any] = {
            "initial": self.initial,
            "start": self.start,
            "views": self.views,
            "growth": self.growth,
            "degree": self.degree,
            "stopped": self.stopped,
            "restored": self._restored,
            "measured": self.measured,
            "rounds": self.rounds,
        }
        if self._best is not None:
            measurement, gaussians = self._best
            state |= {"best": {"measurement": measurement, "sh_count": gaussians.sh.shape[1], **vars(gaussians)}}
        return state

    def restore(self, saved: SavedState) -> None:
        """Continue from a `snapshot`; raises `InputError` where it is damaged."""
        names = ("views", "start", "growth", "degree")
        self.views, self.start, self.growth, self.degree = (saved.value(name, str) for name in names)
        self._restored = saved.value("restored", str)
        self.initial = saved.number("initial", 0, 2**62)
        self.stopped = saved.value("stopped", bool)
        self.measured, self.rounds = (
            [_measurement(saved, entry) for entry in saved.value(name, list)] for name in ("measured", "rounds")
        )
        if "best" in saved:
            best = saved.part("best")
            measurement = _measurement(best, best.value("measurement", list))
            gaussians = ParameterSet.restored(best, measurement.gaussians, best.number("sh_count", 1, 16), "cpu")
            self._best = measurement, gaussians.to_gaussians()

    def keep_if_best(self, measurement: Measurement, fit: Fit) -> None:
        """Keep a copy of the Gaussians if no measurement was better."""
        if self._best is None or measurement.psnr > self._best[0].psnr:
            self._best = measurement, fit.parameters.to_gaussians()

    def forget_best(self) -> None:
        """Compare from now on only with what comes: the loss, or the number of Gaussians, is another one."""
        self._best = None
        self.measured.clear()

    def restore_best(self, now: Measurement, fit: Fit) -> None:
        """Put the best Gaussians back, unless those of `now` are about as good."""
        if self._best is None or self._best[0].psnr < now.psnr + _WORTH_RESTORING:
            return
        best, gaussians = self._best
        fit.restart(gaussians)
        gain = best.psnr - now.psnr
        self._restored = f"the Gaussians of step {best.step} were restored, because they were {gain:.2f} dB better"

    def in_words(self, step: int, fit: Fit) -> dict[str, Any]:
        """For the report, after the last step of a run."""
        if self.limit is not None:
            verdict = f"limited to {self.limit:,}, as asked for"
        else:
            verdict = self.growth or "growth paid to the end of its schedule"
        degree = fit.parameters.sh_count**0.5 - 1
        words = {
            "strategy": self.strategy,
            "views": self.views,
            "gaussians": f"{self.initial:,} at the start, {len(fit):,} at the end; {verdict}",
            "steps": f"{step:,} of {self.steps:,}"
            + (": the validation views no longer improved" if self.stopped else ""),
            "sh_degree": f"{degree:.0f}" + (f": {self.degree}" if self.degree else ""),
        }
        words |= {"start": self.start} if self.start else {}
        return words | ({"restored": self._restored} if self._restored else {})
