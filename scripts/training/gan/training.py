"""Trains the conditional GAN: from nothing to weights in one schedule, and on from a checkpoint.

The generator minimises L_GAN + λ L_cd + λ_1 L1 (Hu and Xiao 2026, Eq. 5): L_cd is the objective by which a fit judges
its starts, relative to that of the untouched picture so that no scene rules the others, and L1 compares what is shown
with what fitted networks show. What is shown always has the scene's budget. The scaling is part of what is
differentiated, so that a change that is not worth its ΔE is unlearned.

Both networks are trained by Adam, whose rates fall linearly to zero after half of the steps. Step k draws its scenes
from (seed, k) alone.
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
from torch import Tensor
from torch.func import functional_call

from ....core.color.spaces import srgb_to_lab
from ....core.enhance.gan.conditioning import observer_features
from ....core.enhance.gan.networks import DIRECTIONS, Generator, GeneratorConfig
from ....core.enhance.gan.prediction import scene_condition, start_table
from ....core.enhance.gan.weights import save_generator
from ....core.enhance.scene.fit import START_WEIGHTS, FitSettings
from ....core.enhance.scene.network import SceneNetwork, features, seen_features
from ....core.enhance.scene.objective import Objective, ObjectiveWeights, smooth_change
from ....core.runtime.protocol import Reporter
from .checkpoint import load_checkpoint, save_checkpoint
from .examples import DRAWN, KEPT, Pairs, Scene, draw_scene, watched
from .losses import Discriminator, discriminator_loss, generator_loss

STAGE = "training"
CHECKPOINT = "checkpoint.safetensors"
WEIGHTS = "enhancer.safetensors"
LOG = "log.csv"

_COLUMNS = ("step", "seconds", "objective", "l1", "adversarial", "discriminator", "kept", "kept_l1")
_LEAST_OBJECTIVE = 3.0  # an untouched picture with less has hardly anything to gain
_LEAST_RATIO = 0.02  # added to a relative objective, whose logarithm is taken
_SCALES = (0.01, 3.0)  # of a predicted change, to the budget
_RAMP = 100  # steps over which the rates rise
_OTHER_SHARE = 0.15  # of the scenes, on which the direction is trained that is not the better one
_ROUGHNESS = 0.3 * FitSettings().roughness  # it adds up over many scenes; the fit that follows takes out the rest


@dataclass(frozen=True)
class TrainingSettings:
    """What a training depends on.

    Attributes:
        steps: of the generator.
        drawn: scenes a step without a fitted network; there is one with.
        window: drawings that are in use at a time; each step replaces one.
        steps_a_pair: steps after which there is one pair more.
        pairs: that there are at most, and at first.
        rate, discriminator_rate: of Adam.
        objective: weights of its terms.
        objective_weight, l1_weight: λ and λ_1.
        adversarial_weight: of L_GAN; 0 trains without an adversary.
        average_decay: of the running mean of the generator's weights, which is what is kept.
        log_every, checkpoint_every: steps between two lines of the log, seconds between two checkpoints.
        kept: scenes for the log's last columns.
        seed: of everything.
        generator: the network's shape.
    """

    steps: int = 1850
    drawn: int = 3
    window: int = 256
    steps_a_pair: int = 80
    pairs: tuple[int, int] = (400, 8)
    rate: float = 1e-3
    discriminator_rate: float = 2e-4
    objective: ObjectiveWeights = START_WEIGHTS
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
            "generator": torch.optim.Adam(self.generator.parameters(), settings.rate, (0.9, 0.99)),
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
        judged = [_Judged(scene, settings.objective) for scene in (*scenes, pair)]
        both = predict(self.generator, [*scenes, pair])
        with torch.no_grad():
            better = [one.better(states) for one, states in zip(judged, both, strict=True)]
        trained = [1 - best if generator.random() < _OTHER_SHARE else best for best in better]
        losses, shown = zip(
            *(one.loss(states[which]) for one, states, which in zip(judged, both, trained, strict=True)), strict=True
        )
        ratios = torch.stack(losses)
        # The logarithm: a picture that the prediction spoils does not rule the step, and one whose contrast can be
        # restored, such as cloth, goes on counting when most of it is.
        objective = (ratios + _LEAST_RATIO).log().mean()
        target = judged[-1].target()
        l1 = (shown[-1] - target).abs().mean()
        loss = settings.objective_weight * objective + settings.l1_weight * l1
        found = {"objective": ratios.mean().item(), "l1": l1.item()}
        self._set_rates()
        if settings.adversarial_weight:
            told = observer_features(pair.observer)[None]
            photograph, real, fake = pair.view(0)[None], target[None], shown[-1][None]
            found |= self._train_discriminator(photograph, real, fake.detach(), told)
            adversarial = generator_loss(self._discriminator(photograph, fake, told))
            loss = loss + settings.adversarial_weight * adversarial
            found["adversarial"] = adversarial.item()
        optimizer = self._optimizers["generator"]
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.generator.parameters(), 20.0)
        optimizer.step()
        self._follow()
        return found

    def _train_discriminator(self, photograph: Tensor, real: Tensor, fake: Tensor, told: Tensor) -> dict[str, float]:
        judge, optimizer = self._discriminator, self._optimizers["discriminator"]
        loss = discriminator_loss(judge(photograph, real, told), judge(photograph, fake, told))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return {"discriminator": loss.item()}

    def _set_rates(self) -> None:
        share = min((self.step + 1) / _RAMP, 1.0, 2.0 * (1.0 - self.step / self._settings.steps))
        rates = {"generator": self._settings.rate, "discriminator": self._settings.discriminator_rate}
        for name, optimizer in self._optimizers.items():
            for group in optimizer.param_groups:
                group["lr"] = share * rates[name]

    def _follow(self) -> None:
        """Move the running mean of the weights; at first it forgets faster."""
        decay = min(self._settings.average_decay, (1.0 + self.step) / (10.0 + self.step))
        with torch.no_grad():
            for mean, value in zip(self.average.parameters(), self.generator.parameters(), strict=True):
                mean.lerp_(value, 1.0 - decay)

    def _log(self, sums: Sequence[dict[str, float]], seconds: float) -> None:
        means = {name: float(np.mean([one[name] for one in sums])) for name in sums[0]}
        objective, l1 = judge_kept(self.average, [self._kept[number] for number in range(self._settings.kept)])
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


def predict(generator: Generator, scenes: Sequence[Scene]) -> list[list[dict[str, Tensor]]]:
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


def judge_kept(generator: Generator, scenes: Sequence[Scene]) -> tuple[float, float]:
    """Mean relative objective of the better predictions, and mean difference of what they and fitted networks show.

    The objective is that of a fit, whatever the training's weights.
    """
    objectives, differences = [], []
    with torch.no_grad():
        for scene in scenes:
            torch.manual_seed(0)
            (states,) = predict(generator, [scene])
            judged = _Judged(scene, ObjectiveWeights())
            loss, shown = judged.loss(states[judged.better(states)])
            objectives.append(loss.item())
            differences.append((shown - judged.target()).abs().mean().item())
    return float(np.mean(objectives)), float(np.mean(differences))


class _Judged:
    """The first view of a scene, with what is needed to judge a prediction."""

    def __init__(self, scene: Scene, weights: ObjectiveWeights) -> None:
        self._scene, self._view = scene, scene.view(0)
        self._objective = Objective(self._view, scene.observer, weights=weights)
        self._colors = self._view.flatten(1).T.contiguous()
        self._features = features(self._view, scene.observer)
        with torch.no_grad():
            self._before = max(float(self._objective(self._view, 0.0)), _LEAST_OBJECTIVE)

    def loss(self, state: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """The relative objective of a prediction, and the (3, H, W) picture it shows."""
        network = SceneNetwork(self._scene.observer)
        predicted = functional_call(network, state, (self._colors, self._features)).T.reshape(self._view.shape)
        scale = self._scale(predicted)
        shown = self._view + scale * (predicted - self._view)
        table = scale * state["table"]
        rough = torch.stack([torch.diff(table, n=2, dim=axis).pow(2).mean() for axis in range(3)]).sum()
        return (self._objective(shown, 0.0) + _ROUGHNESS * rough) / self._before, shown.clamp(0.0, 1.0)

    def better(self, states: Sequence[dict[str, Tensor]]) -> int:
        """Which of some predictions has the least objective."""
        losses = [float(self.loss(state)[0]) for state in states]
        return losses.index(min(losses))

    def target(self) -> Tensor:
        """(3, H, W) what the fitted network shows."""
        fitted = self._scene.fitted
        assert fitted is not None
        with torch.no_grad():
            shown = fitted(self._colors, self._features).T.reshape(self._view.shape)
        return shown.clamp(0.0, 1.0)

    def _scale(self, predicted: Tensor) -> Tensor:
        """What the change is multiplied by to have the budget; its slope is that of a smooth ΔE."""
        scale = self._scene.budget / max(self._objective.change(predicted), 1e-3)
        change = smooth_change(srgb_to_lab(self._view), srgb_to_lab(predicted.clamp(0.0, 1.0))).mean() + 1e-3
        return min(max(scale, _SCALES[0]), _SCALES[1]) * (change.detach() / change)
