"""Trains the conditional GAN on a paired dataset, on CPU or CUDA, resumable from a checkpoint.

The generator minimises L_GAN + λ_cd L_cd + λ_1 L1 (Hu and Xiao 2026, Eq. 5), the discriminator its halved cross
entropy; both by Adam, whose rate falls linearly to zero after half of the steps. Step k draws its batch from (seed, k)
alone, so a resumed training sees what an uninterrupted one would have seen.
"""

from __future__ import annotations

import copy
import csv
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ....core.color.metrics import ccpr, ssim
from ....core.color.protected_colors import skin_like
from ....core.color.spaces import linear_to_srgb, linear_to_xyz, srgb_to_lab, srgb_to_linear, xyz_to_lab
from ....core.enhance.gan.networks import Generator, GeneratorConfig
from ....core.enhance.gan.weights import load_generator, save_generator
from ....core.runtime.protocol import Reporter
from .batches import Batch, Examples, ObserverBatch
from .checkpoint import load_checkpoint, save_checkpoint
from .losses import Discriminator, contrast_distance, discriminator_loss, generator_loss, structure_distance

CHECKPOINT = "checkpoint.safetensors"
WEIGHTS = "enhancer.safetensors"
LOG = "log.csv"


@dataclass(frozen=True)
class TrainingSettings:
    """What a training run depends on besides its data.

    Attributes:
        steps: generator updates; 0.5 `steps` at the full rate.
        batch, crop: images a step and their sides in pixels, a multiple of the generator's stride.
        learning_rate, beta1: of Adam, for both networks.
        l1_weight, contrast_weight, structure_weight: λ_1, and λ_cd of the two parts of L_cd.
        adversarial_weight: of L_GAN; 0 trains without discriminator.
        contrast_offsets: see `contrast_distance`.
        one_sided: see `contrast_distance`.
        discriminator_width: channels of the discriminator's first layer.
        held_weight: of L1 where the original's colours are skin-like, besides 1.
        protection: how far the targets of skin-like colours are moved back to the original; the teacher does not know
            that people look at faces. L_cd does not move such colours either.
        hard_share: share of the batch drawn by how much the teacher changes a pair; the rest is drawn evenly.
        average_decay: of the running mean of the weights, which is what is kept.
        seed: of initial weights and batches.
        generator: the network's shape.
    """

    steps: int = 9_200
    batch: int = 4
    crop: int = 128
    learning_rate: float = 1e-3
    beta1: float = 0.5
    l1_weight: float = 100.0
    contrast_weight: float = 200.0
    structure_weight: float = 150.0
    adversarial_weight: float = 1.0
    contrast_offsets: tuple[int, ...] = (1, 6, 24)
    one_sided: bool = True
    discriminator_width: int = 8
    held_weight: float = 3.0
    protection: float = 0.6
    hard_share: float = 0.5
    average_decay: float = 0.999
    seed: int = 0
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    def rate(self, step: int) -> float:
        """Factor of the learning rate at a step."""
        return min(1.0, 2.0 * (1.0 - step / self.steps))


class Training:
    """A training run in a folder: ``checkpoint.safetensors``, ``enhancer.safetensors`` and ``log.csv``.

    Args:
        folder: continues the run found there, which has to have the same settings apart from `steps`.
        examples: what to learn from.
        validation: what the log measures on; not learnt from.
        settings: see there.
        device: of torch.
        start: weights to begin with instead of random ones; the settings' generator has to be theirs.
        workers: threads that share each batch. On a CPU two of them, of one torch thread each, were 1.4 times as fast
            as two torch threads, because a network this small gives those little to share.

    Raises:
        InputError: the folder's checkpoint is damaged or of other settings.
    """

    def __init__(
        self,
        folder: Path,
        examples: Examples,
        validation: Examples,
        settings: TrainingSettings,
        device: str = "cpu",
        workers: int = 1,
        start: Path | None = None,
    ) -> None:
        if settings.batch % workers:
            raise ValueError(f"{workers} workers cannot share batches of {settings.batch}")
        self._workers, self._pool = workers, ThreadPoolExecutor(workers)
        self.settings, self.folder, self.step = settings, folder, 0
        self._examples, self._validation, self._device = examples, validation, device
        torch.manual_seed(settings.seed)
        self.generator = Generator(settings.generator).to(device)
        if start is not None:
            self.generator.load_state_dict(load_generator(start).state_dict())
        self._discriminator = Discriminator(settings.discriminator_width).to(device)
        self.average = copy.deepcopy(self.generator).requires_grad_(False)
        self._optimizers = {
            name: torch.optim.Adam(network.parameters(), settings.learning_rate, (settings.beta1, 0.999))
            for name, network in (("generator", self.generator), ("discriminator", self._discriminator))
        }
        folder.mkdir(parents=True, exist_ok=True)
        if (folder / CHECKPOINT).is_file():
            self.step = load_checkpoint(folder / CHECKPOINT, self._networks(), self._optimizers, settings.to_dict())

    def run(
        self, reporter: Reporter | None = None, *, log_every: int = 500, notes: dict[str, str] | None = None
    ) -> None:
        """Train to the last step; a checkpoint is written at every log line and when the run is interrupted."""
        reporter = reporter or Reporter()
        losses: list[dict[str, float]] = []
        with ThreadPoolExecutor(1) as loader:
            coming = loader.submit(self._batch, self.step)
            try:
                while self.step < self.settings.steps:
                    batch = coming.result()
                    coming = loader.submit(self._batch, self.step + 1)
                    losses.append(self._update(batch))
                    self.step += 1
                    message = f"step {self.step}, L1 {losses[-1]['l1']:.4f}, contrast {losses[-1]['contrast']:.4f}"
                    reporter.progress("train", self.step / self.settings.steps, message)
                    if self.step % log_every == 0 or self.step == self.settings.steps:
                        self._log(losses)
                        losses.clear()
                        self.save(notes)
            except BaseException:
                self.save(notes)
                raise

    def save(self, notes: dict[str, str] | None = None) -> None:
        """Write the checkpoint and the weights as they are now."""
        save_checkpoint(
            self.folder / CHECKPOINT, self._networks(), self._optimizers, self.step, self.settings.to_dict()
        )
        save_generator(self.average, self.folder / WEIGHTS, {"step": str(self.step), **(notes or {})})

    def _networks(self) -> dict[str, nn.Module]:
        return {"generator": self.generator, "discriminator": self._discriminator, "average": self.average}

    def _batch(self, step: int) -> Batch:
        generator = np.random.default_rng([self.settings.seed, step])
        return self._examples.draw(generator, self.settings.batch, self.settings.crop, self.settings.hard_share)

    def _update(self, batch: Batch) -> dict[str, float]:
        """One step of both networks; returns the losses."""
        settings = self.settings
        for optimizer in self._optimizers.values():
            optimizer.param_groups[0]["lr"] = settings.learning_rate * settings.rate(self.step)
        parts = [_Part.of(part, settings.protection, self._device) for part in batch.split(self._workers)]
        self._discriminator.requires_grad_(False)
        self._optimizers["generator"].zero_grad(set_to_none=True)
        results = list(self._pool.map(self._generator_gradients, parts))
        self._optimizers["generator"].step()
        losses = [losses for losses, _ in results]
        if settings.adversarial_weight:
            self._discriminator.requires_grad_(True)
            self._optimizers["discriminator"].zero_grad(set_to_none=True)
            candidates = [candidate for _, candidate in results]
            judged = list(self._pool.map(self._discriminator_gradients, parts, candidates))
            self._optimizers["discriminator"].step()
            losses = [{**loss, "discriminator": value} for loss, value in zip(losses, judged, strict=True)]
        self._update_average()
        return {name: float(np.mean([loss[name] for loss in losses])) for name in losses[0]}

    def _generator_gradients(self, part: _Part) -> tuple[dict[str, float], Tensor]:
        """Add a part's share to the generator's gradients; returns the losses and what was generated."""
        settings, observers, original = self.settings, part.observers, part.original
        mapped = part.generate(self.generator)
        candidate = mapped.clamp(0.0, 1.0)
        free = torch.where(part.held, candidate.detach(), candidate)
        linear = observers.simulate_linear(srgb_to_linear(free))
        seen = xyz_to_lab(linear_to_xyz(linear))
        contrast = contrast_distance(srgb_to_lab(original), seen, settings.contrast_offsets, settings.one_sided)
        structure = structure_distance(original, linear_to_srgb(linear))
        # Unclipped, so that a pixel that left the gamut still finds back.
        weights = 1.0 + settings.held_weight * part.held.to(original)
        distance = (weights * (mapped - part.target).abs()).mean()
        loss = (
            settings.l1_weight * distance + settings.contrast_weight * contrast + settings.structure_weight * structure
        )
        losses = {"l1": distance.item(), "contrast": contrast.item(), "structure": structure.item()}
        if settings.adversarial_weight:
            adversarial = generator_loss(self._discriminator(original, candidate, observers.features))
            loss = loss + settings.adversarial_weight * adversarial
            losses["adversarial"] = adversarial.item()
        (loss / self._workers).backward()
        return losses, candidate.detach()

    def _discriminator_gradients(self, part: _Part, candidate: Tensor) -> float:
        """Add a part's share to the discriminator's gradients; returns its loss."""
        judged = [
            self._discriminator(part.original, image, part.observers.features) for image in (part.target, candidate)
        ]
        loss = discriminator_loss(*judged)
        (loss / self._workers).backward()
        return loss.item()

    def _update_average(self) -> None:
        # The first steps would weigh too long in a mean of fixed memory.
        decay = min(self.settings.average_decay, (1.0 + self.step) / (10.0 + self.step))
        with torch.no_grad():
            for mean, value in zip(self.average.parameters(), self.generator.parameters(), strict=True):
                mean.lerp_(value, 1.0 - decay)

    def _log(self, losses: Sequence[dict[str, float]]) -> None:
        row: dict[str, Any] = {"step": self.step, "time": round(time.time(), 1)}
        row |= {name: round(float(np.mean([loss[name] for loss in losses])), 5) for name in losses[0]}
        row |= {name: round(value, 5) for name, value in validate(self.average, self._validation, self._device).items()}
        path = self.folder / LOG
        new = not path.is_file()
        with open(path, "a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(row))
            if new:
                writer.writeheader()
            writer.writerow(row)


@dataclass(frozen=True)
class _Part:
    """What the networks see of a batch, on their device.

    Attributes:
        observers, palettes: one for each of the B images.
        original, proposal: (B, 3, H, W), and what the teacher makes of them, from which the generator starts.
        held: (B, 1, H, W) bool, where the original's colours are skin-like.
        target: (B, 3, H, W), the proposal with the held colours moved back to the original.
    """

    observers: ObserverBatch
    palettes: Tensor
    original: Tensor
    proposal: Tensor
    held: Tensor
    target: Tensor

    @classmethod
    def of(cls, batch: Batch, protection: float, device: str) -> _Part:
        """`protection`: how far the held colours are moved back."""
        original, proposal = batch.original.to(device), batch.target.to(device)
        held = skin_like(original)[:, None]
        target = torch.lerp(proposal, original, protection * held.to(original))
        return cls(ObserverBatch(batch.observers, device), batch.palettes.to(device), original, proposal, held, target)

    def generate(self, generator: Generator) -> Tensor:
        """(B, 3, H, W) what the generator makes of the originals, not clipped."""
        observers = self.observers
        change = generator(
            self.original,
            observers.simulate(self.original),
            self.proposal,
            observers.simulate(self.proposal),
            observers.features,
            observers.severities,
            self.palettes,
        )
        return self.original + change


def validate(generator: Generator, examples: Examples, device: str = "cpu", batch: int = 8) -> dict[str, float]:
    """How a generator does on examples that it has not learnt from.

    Returns:
        `distance`: mean absolute difference to the teacher; `shift`: mean ΔE76 to the original; CCPR (τ = 6), averaged
        over images, of the simulated original (`ccpr_input`), of the teacher's (`ccpr_teacher`) and of the generator's
        (`ccpr`); likewise SSIM(original, S(·)); `shift_teacher`: the teacher's mean ΔE76.
    """
    totals: dict[str, list[float]] = {}
    for first in range(0, len(examples), batch):
        images = examples.whole(range(first, min(first + batch, len(examples))))
        with torch.inference_mode():
            part = _Part.of(images, 0.0, device)
            original, teacher = part.original, part.proposal
            candidate = part.generate(generator).clamp(0.0, 1.0)
            for suffix, image in (("_input", original), ("_teacher", teacher), ("", candidate)):
                pairs = list(zip(original, part.observers.simulate(image), strict=True))
                totals.setdefault(f"ccpr{suffix}", []).extend(ccpr(*pair)[0] for pair in pairs)
                totals.setdefault(f"ssim{suffix}", []).extend(ssim(*pair) for pair in pairs)
            totals.setdefault("distance", []).extend((candidate - teacher).abs().mean((1, 2, 3)).tolist())
            for name, image in (("shift", candidate), ("shift_teacher", teacher)):
                totals.setdefault(name, []).extend(_shift(original, image))
    return {name: float(np.nanmean(values)) for name, values in totals.items()}


def _shift(original: Tensor, image: Tensor) -> list[float]:
    difference: Tensor = srgb_to_lab(original) - srgb_to_lab(image)
    return difference.norm(dim=1).mean((1, 2)).tolist()
