"""Trains the conditional GAN: from nothing to weights in one schedule, and on from a checkpoint.

The generator minimises L_GAN + λ L_cd + λ_1 L1 (Hu and Xiao 2026, Eq. 5): L_cd is the objective by which a fit judges
its starts, relative to that of the untouched picture so that no scene rules the others, and L1 compares what is shown
with what fitted networks show. What is shown always has the scene's budget. The scaling is part of what is
differentiated, so that a change that is not worth its ΔE is unlearned.

At the end the generator stays as it is but for the sizes of the steps that correct a prediction, which are learned
by what the corrected prediction shows.

Networks are trained by Adam, whose rates fall linearly to zero after half of the steps, and anew of those at the end.
Step k draws its scenes from (seed, k) alone.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ....core.enhance.gan.conditioning import observer_features
from ....core.enhance.gan.networks import DIRECTIONS, Generator, GeneratorConfig, State
from ....core.enhance.gan.prediction import scene_condition, start_table
from ....core.enhance.gan.trial import CORRECTION_WEIGHTS, Trial
from ....core.enhance.gan.weights import save_generator
from ....core.enhance.scene.fit import START_WEIGHTS
from ....core.enhance.scene.network import features, seen_features
from ....core.enhance.scene.objective import ObjectiveWeights
from ....core.runtime.protocol import Reporter
from .checkpoint import load_checkpoint, save_checkpoint
from .examples import DRAWN, KEPT, Pairs, Scene, draw_scene, watched
from .losses import Discriminator, discriminator_loss, generator_loss

STAGE = "training"
CHECKPOINT = "checkpoint.safetensors"
WEIGHTS = "enhancer.safetensors"
LOG = "log.csv"

_COLUMNS = ("step", "seconds", "objective", "l1", "adversarial", "discriminator", "kept", "kept_l1")
_LEAST_RATIO = 0.02  # added to a relative objective, whose logarithm is taken
_RAMP = 100  # steps over which the rates rise
_AGAIN_SHARE = 0.5  # of the corrections, which begin with what a correction has given
_OTHER_SHARE = 0.15  # of the scenes, on which the direction is trained that is not the better one


@dataclass(frozen=True)
class TrainingSettings:
    """What a training depends on.

    Attributes:
        steps: of the training.
        correction_share: of the steps, at the end, in which the sizes of corrections are learned.
        drawn: scenes a step without a fitted network; there is one with.
        window: drawings that are in use at a time; each step replaces one.
        steps_a_pair: steps after which there is one pair more.
        pairs: that there are at most, and at first.
        rate, correction_rate, discriminator_rate: of Adam; the second for the logarithms of the sizes of corrections.
        objective, correction_objective: weights of its terms, for a prediction and for a corrected one.
        objective_weight, l1_weight: λ and λ_1.
        adversarial_weight: of L_GAN; 0 trains without an adversary.
        average_decay: of the running mean of the generator's weights, which is what is kept.
        log_every, checkpoint_every: steps between two lines of the log, seconds between two checkpoints.
        kept: scenes for the log's last columns.
        seed: of everything.
        generator: the network's shape.
    """

    steps: int = 2250
    correction_share: float = 0.18
    drawn: int = 3
    window: int = 256
    steps_a_pair: int = 80
    pairs: tuple[int, int] = (400, 8)
    rate: float = 1e-3
    correction_rate: float = 0.03
    discriminator_rate: float = 2e-4
    objective: ObjectiveWeights = START_WEIGHTS
    correction_objective: ObjectiveWeights = CORRECTION_WEIGHTS
    objective_weight: float = 12.0
    l1_weight: float = 20.0
    adversarial_weight: float = 0.3
    average_decay: float = 0.995
    log_every: int = 100
    checkpoint_every: float = 120.0
    kept: int = 8
    seed: int = 0
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)

    def to_dict(self) -> dict[str, Any]:
        """JSON values."""
        return asdict(self)


class Training:
    """A training in a folder.

    Args:
        folder: receives checkpoint, weights, log and pairs; what is there is gone on with.
        settings: see there.
    """

    def __init__(self, folder: Path, settings: TrainingSettings) -> None:
        self._folder, self._settings = folder, settings
        folder.mkdir(parents=True, exist_ok=True)
        torch.manual_seed(settings.seed)
        self.generator, self.average = Generator(settings.generator), Generator(settings.generator)
        self.average.load_state_dict(self.generator.state_dict())
        self._discriminator = Discriminator()
        self._networks = {"generator": self.generator, "average": self.average, "discriminator": self._discriminator}
        self._optimizers = {
            "generator": torch.optim.Adam(_predicting(self.generator), settings.rate, (0.9, 0.99)),
            "correction": torch.optim.Adam([self.generator.rates], settings.correction_rate, (0.9, 0.99)),
            "discriminator": torch.optim.Adam(
                self._discriminator.parameters(), settings.discriminator_rate, (0.5, 0.99)
            ),
        }
        self._pairs = Pairs(folder / "pairs", settings.seed)
        self._kept = Pairs(folder / "pairs", settings.seed, KEPT)
        self.step = 0
        if (folder / CHECKPOINT).exists():
            described = settings.to_dict()
            self.step = load_checkpoint(folder / CHECKPOINT, self._networks, self._optimizers, described)
            _keep_lines(folder / LOG, self.step)

    def run(self, reporter: Reporter, notes: dict[str, str] | None = None) -> None:
        """Train up to the last step, and write the weights; `notes` are kept with them.

        Raises:
            InputError: a file of the folder cannot be used.
        """
        saved = started = time.monotonic()
        sums: list[dict[str, float]] = []
        while self.step < self._settings.steps:
            sums.append(self._train())
            self.step += 1
            reporter.progress(STAGE, self.step / self._settings.steps, f"step {self.step}")
            is_last = self.step == self._settings.steps
            if self.step % self._settings.log_every == 0 or is_last:
                self._log(sums, time.monotonic() - started)
                sums = []
            if is_last or time.monotonic() - saved > self._settings.checkpoint_every:
                self._save(notes or {})
                saved = time.monotonic()

    def _save(self, notes: dict[str, str]) -> None:
        settings = self._settings.to_dict()
        save_checkpoint(self._folder / CHECKPOINT, self._networks, self._optimizers, self.step, settings)
        save_generator(self.average, self._folder / WEIGHTS, {**notes, "step": str(self.step)})

    def _train(self) -> dict[str, float]:
        """One step; returns its losses."""
        settings = self._settings
        generator = np.random.default_rng([settings.seed, self.step])
        drawn = self.step + generator.choice(settings.window, settings.drawn, replace=False)
        scenes = [watched(draw_scene(settings.seed, DRAWN, int(number)), generator) for number in drawn]
        most, first = settings.pairs
        pair = self._pairs[int(generator.integers(min(first + self.step // settings.steps_a_pair, most)))]
        torch.manual_seed(int(generator.integers(2**62)))  # after what may be there already, or not
        scenes = [*scenes, pair]
        weights = settings.correction_objective if self._is_correcting else settings.objective
        trials = [trial_of(scene, weights) for scene in scenes]
        states = self._predicted(scenes, trials, generator)
        losses, views = zip(*(trial.loss(state) for trial, state in zip(trials, states, strict=True)), strict=True)
        shown = views[-1][0].clamp(0.0, 1.0)
        ratios = torch.stack(losses)
        # The logarithm: a picture that the prediction spoils does not rule the step, and one whose contrast can be
        # restored, such as cloth, goes on counting when most of it is.
        objective = (ratios + _LEAST_RATIO).log().mean()
        target = shown_by_fit(pair)
        l1 = (shown - target).abs().mean()
        loss = settings.objective_weight * objective + settings.l1_weight * l1
        found = {"objective": ratios.mean().item(), "l1": l1.item()}
        self._set_rates()
        if settings.adversarial_weight:
            told = observer_features(pair.observer)[None]
            photograph, real, fake = pair.view(0)[None], target[None], shown[None]
            found |= self._train_discriminator(photograph, real, fake.detach(), told)
            adversarial = generator_loss(self._discriminator(photograph, fake, told))
            loss = loss + settings.adversarial_weight * adversarial
            found["adversarial"] = adversarial.item()
        optimizer = self._optimizers["correction" if self._is_correcting else "generator"]
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self._trained(self.generator), 20.0)
        optimizer.step()
        self._follow()
        return found

    def _predicted(
        self, scenes: Sequence[Scene], trials: Sequence[Trial], generator: np.random.Generator
    ) -> list[State]:
        """A prediction for each scene, or a corrected one, in one direction."""
        if not self._is_correcting:
            return _directed(self.generator, scenes, trials, generator)
        with torch.no_grad():
            states = _directed(self.average, scenes, trials, generator)
            if generator.random() < _AGAIN_SHARE:
                states = _corrected(self.average, trials, states)
        return _corrected(self.generator, trials, states)

    def _train_discriminator(self, photograph: Tensor, real: Tensor, fake: Tensor, told: Tensor) -> dict[str, float]:
        judge, optimizer = self._discriminator, self._optimizers["discriminator"]
        loss = discriminator_loss(judge(photograph, real, told), judge(photograph, fake, told))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return {"discriminator": loss.item()}

    @property
    def _predicting_steps(self) -> int:
        return round((1.0 - self._settings.correction_share) * self._settings.steps)

    @property
    def _is_correcting(self) -> bool:
        return self.step >= self._predicting_steps

    def _trained(self, generator: Generator) -> list[nn.Parameter]:
        return [generator.rates] if self._is_correcting else _predicting(generator)

    def _set_rates(self) -> None:
        settings, first = self._settings, self._predicting_steps
        step, steps = (self.step - first, settings.steps - first) if self._is_correcting else (self.step, first)
        share = min((step + 1) / _RAMP, 1.0, 2.0 * (1.0 - step / steps))
        rates = {
            "generator": settings.rate,
            "correction": settings.correction_rate,
            "discriminator": settings.discriminator_rate,
        }
        for name, optimizer in self._optimizers.items():
            for group in optimizer.param_groups:
                group["lr"] = share * rates[name]

    def _follow(self) -> None:
        """Move the running mean of the weights; at first it forgets faster."""
        step = self.step - self._predicting_steps if self._is_correcting else self.step
        decay = min(self._settings.average_decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            for mean, value in zip(self._trained(self.average), self._trained(self.generator), strict=True):
                mean.lerp_(value, 1.0 - decay)

    def _log(self, sums: Sequence[dict[str, float]], seconds: float) -> None:
        means = {name: float(np.mean([one[name] for one in sums])) for name in sums[0]}
        kept = [self._kept[number] for number in range(self._settings.kept)]
        objective, l1 = judge_kept(self.average, kept, corrected=self.step > self._predicting_steps)
        row = {"step": self.step, "seconds": round(seconds), **means, "kept": objective, "kept_l1": l1}
        path = self._folder / LOG
        is_new = not path.exists()
        with path.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, _COLUMNS, restval="")
            if is_new:
                writer.writeheader()
            writer.writerow({k: f"{v:.4f}" if isinstance(v, float) else v for k, v in row.items()})


def _keep_lines(path: Path, last: int) -> None:
    """Keep the lines of a log up to a step: what comes after it was not in the checkpoint, and is done again."""
    if path.exists():
        header, *lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        path.write_text(header + "".join(line for line in lines if int(line.split(",")[0]) <= last), encoding="utf-8")


def _predicting(generator: Generator) -> list[nn.Parameter]:
    """The parameters that a prediction depends on."""
    return [one for one in generator.parameters() if one is not generator.rates]


def _directed(
    network: Generator, scenes: Sequence[Scene], trials: Sequence[Trial], generator: np.random.Generator
) -> list[State]:
    """A prediction for each scene, mostly the better one."""
    both = predict(network, scenes)
    better = [trial.better(states) for trial, states in zip(trials, both, strict=True)]
    chosen = [1 - best if generator.random() < _OTHER_SHARE else best for best in better]
    return [states[which] for states, which in zip(both, chosen, strict=True)]


def predict(generator: Generator, scenes: Sequence[Scene]) -> list[list[State]]:
    """The states of a scene network for each scene, one of each of `DIRECTIONS`."""
    views = [[(scene.view(number), None) for number in range(len(scene.drawing.views))] for scene in scenes]
    told = torch.stack(
        [scene_condition(mine, scene.observer, scene.budget) for mine, scene in zip(views, scenes, strict=True)]
    )
    counts = [len(mine) for mine in views]
    seen = [
        seen_features(pixels, scene.observer) for mine, scene in zip(views, scenes, strict=True) for pixels, _ in mine
    ]
    summaries = generator.summary(torch.stack(seen), told.repeat_interleave(torch.tensor(counts), 0))
    means = torch.stack([mine.mean(0) for mine in summaries.split(counts)])
    starts = torch.stack([start_table(scene.observer) for scene in scenes])
    states = [generator(means, told, starts, direction) for direction in DIRECTIONS]
    return [
        [{name: values[index] for name, values in towards.items()} for towards in states]
        for index in range(len(scenes))
    ]


def _corrected(generator: Generator, trials: Sequence[Trial], states: Sequence[State]) -> list[State]:
    """The states after a correction."""
    drafts = [trial.draft(state) for trial, state in zip(trials, states, strict=True)]
    return [generator.corrected(draft.state, draft.gradient) for draft in drafts]


def trial_of(scene: Scene, weights: ObjectiveWeights) -> Trial:
    """A trial of predictions on the first view of a scene."""
    return Trial([(scene.view(0), None)], scene.observer, scene.budget, weights)


def shown_by_fit(pair: Scene) -> Tensor:
    """(3, H, W) what the fitted network of a pair shows of the first view."""
    assert pair.fitted is not None
    view = pair.view(0)
    with torch.no_grad():
        shown = pair.fitted(view.flatten(1).T, features(view, pair.observer)).T.reshape(view.shape)
    return shown.clamp(0.0, 1.0)


def judge_kept(generator: Generator, scenes: Sequence[Scene], *, corrected: bool) -> tuple[float, float]:
    """Mean relative objective of predictions, and mean difference of what they and fitted networks show.

    The objective is that of a fit, whatever the training's weights.

    Args:
        generator: predicts.
        scenes: with fitted networks.
        corrected: whether they are corrected once.
    """
    objectives, differences = [], []
    with torch.no_grad():
        for scene in scenes:
            torch.manual_seed(0)
            trial = trial_of(scene, ObjectiveWeights())
            (states,) = predict(generator, [scene])
            state = states[trial.better(states)]
            if corrected:
                (state,) = _corrected(generator, [trial], [state])
            loss, (shown,) = trial.loss(state)
            objectives.append(loss.item())
            differences.append((shown.clamp(0.0, 1.0) - shown_by_fit(scene)).abs().mean().item())
    return float(np.mean(objectives)), float(np.mean(differences))
