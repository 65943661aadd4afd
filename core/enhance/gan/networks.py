"""The generator: a U-Net that improves on the teacher's recolouring of each pixel for one observer.

It sees the image and the teacher's proposal, a recolouring of the whole scene by one look-up table, and says how the
proposal is to be changed. So it need not find out which way a scene's colours are to be moved apart, which any single
view leaves open, and it can do what no look-up table can: treat one colour differently from place to place.

As in pix2pix (Isola et al. 2017) convolutions of stride 2 lead down and skip connections back up; different are

- the finest level, which is one narrow layer: recolouring is a function of the pixel and its neighbours, steered by
  features of its surroundings from half resolution downwards. That halves the cost of an image;
- nearest-neighbour upsampling before a convolution, which leaves no checkerboard;
- feature-wise modulation (FiLM, Perez et al. 2018) of every level by the observer and the scene's palette;
- the residual's last layer, which starts at zero: training starts from the proposal;
- the severity as a factor of the residual: at severity 0 the proposal stays as it is, whatever the weights;
- a factor that fades the whole change out towards neutral colours: greys and whites stay, whatever the weights;
- another that takes back part of it in colours like skin: people look at faces.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from ...color.protected_colors import skin_likeness
from .conditioning import OBSERVER_FEATURES, PALETTE_FEATURES

NORMALISATIONS = ("none", "instance", "scene")
_SLOPE = 0.2  # of leaky ReLUs, as in pix2pix
_EPSILON = 1e-5  # added to variances
_NEUTRAL = 0.03  # difference of the largest and the smallest channel at which half of the change is applied

_SKIN_HELD = 0.4  # share of the change that is taken back in colours like skin
_PLANES = 12  # channels of the input: four images

Statistics = dict[int, tuple[Tensor, Tensor]]
"""Mean and variance, (B, C, 1, 1) each, of every normalised layer by its number."""


@dataclass(frozen=True)
class GeneratorConfig:
    """The network's shape; stored with its weights.

    Attributes:
        widths: channels at full resolution, at half, at a quarter, ...
        normalisation: of the inner levels: "none"; "instance", by the statistics of the image at hand; or "scene", by
            those of all views of a scene together, which are taken when the enhancer is fitted. The latter two train
            alike.
        palette: whether the scene's palette steers the network.
        embedding: width of the vector that steers.
    """

    widths: tuple[int, ...] = (16, 24, 32, 64, 96, 128)
    normalisation: str = "none"
    palette: bool = True
    embedding: int = 64

    @property
    def levels(self) -> int:
        """Number of halvings of the resolution."""
        return len(self.widths) - 1

    @property
    def stride(self) -> int:
        """Sides of the network's input are multiples of this."""
        return 2**self.levels

    @property
    def reach(self) -> int:
        """An output pixel depends on no input further away than this, in pixels, rounded up to a whole stride.

        Going down, a 4×4 kernel reaches 2 pixels of the level it reads; coming up, a 3×3 kernel reaches 1 and nearest
        neighbours shift by at most 1.
        """
        down = sum(2 * 2**level for level in range(self.levels))
        up = sum(2 * 2**level for level in range(self.levels))
        return -(-(down + up) // self.stride) * self.stride

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready; `from_dict` reads it back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> GeneratorConfig:
        """The configuration of `to_dict`; ValueError, TypeError or KeyError when it describes no network of ours."""
        config = cls(**{**values, "widths": tuple(values["widths"])})
        sizes = (*config.widths, config.embedding)
        plausible = 2 <= len(config.widths) <= 9 and all(type(w) is int and 1 <= w <= 1024 for w in sizes)
        if not plausible or config.normalisation not in NORMALISATIONS or not isinstance(config.palette, bool):
            raise ValueError("no generator of this shape")
        return config


class Generator(nn.Module):
    """See the module's text."""

    def __init__(self, config: GeneratorConfig = GeneratorConfig()) -> None:
        super().__init__()
        self.config = config
        full, *inner = config.widths
        self.embed = nn.Sequential(
            nn.Linear(OBSERVER_FEATURES + PALETTE_FEATURES * config.palette, config.embedding),
            nn.LeakyReLU(_SLOPE),
            nn.Linear(config.embedding, config.embedding),
            nn.LeakyReLU(_SLOPE),
        )
        self.down = nn.ModuleList(
            _Modulated(nn.Conv2d(before, after, 4, stride=2, padding=1), config.embedding)
            for before, after in zip((_PLANES, *inner[:-1]), inner, strict=True)
        )
        self.up = nn.ModuleList(
            _Modulated(nn.Conv2d(below + here, here, 3, padding=1), config.embedding)
            for below, here in zip(reversed(inner[1:]), reversed(inner[:-1]), strict=True)
        )
        self.steer = nn.Conv2d(inner[0], full, 1)
        self.pixel = _Modulated(nn.Conv2d(_PLANES, full, 3, padding=1), config.embedding)
        self.mix = nn.Conv2d(full, full, 1)
        self.residual = nn.Conv2d(full, 3, 1)
        nn.init.zeros_(self.residual.weight)
        if self.residual.bias is not None:
            nn.init.zeros_(self.residual.bias)
        channels_last(self)

    def forward(
        self,
        image: Tensor,
        simulated: Tensor,
        proposal: Tensor,
        proposal_simulated: Tensor,
        observer: Tensor,
        severity: Tensor,
        palette: Tensor,
        statistics: Statistics | None = None,
        record: Statistics | None = None,
    ) -> Tensor:
        """(B, 3, H, W) what to add to `image`; not clipped.

        Args:
            image: (B, 3, H, W) sRGB in [0, 1], sides multiples of `config.stride`.
            simulated: S(image), likewise.
            proposal: the teacher's recolouring of the image, likewise.
            proposal_simulated: S(proposal), likewise.
            observer: (B, OBSERVER_FEATURES).
            severity: (B,).
            palette: (B, PALETTE_FEATURES); ignored by a network without palette.
            statistics: normalise by these instead of the images' own.
            record: is filled with the images' own.
        """
        norm = _Normaliser(self.config.normalisation != "none", statistics, record)
        steering = self.embed(torch.cat([observer, palette], 1) if self.config.palette else observer)
        # Differences are what matters: what the observer loses, and what the proposal gives back. They are small, so
        # they are scaled up.
        planes = [image - 0.5, simulated - image, proposal - image, proposal_simulated - simulated]
        seen = torch.cat([planes[0], *(2.0 * plane for plane in planes[1:])], 1)
        seen = seen.contiguous(memory_format=torch.channels_last)
        skips, features = [], seen
        for level, layer in enumerate(self.down):
            # As in pix2pix, the outermost layer is not normalised.
            features = layer(features, steering, norm if level else None)
            skips.append(features)
        features = skips.pop()
        for layer in self.up:
            wider = functional.interpolate(features, scale_factor=2.0, mode="nearest")
            features = layer(torch.cat([wider, skips.pop()], 1), steering, norm)
        surroundings = functional.interpolate(
            self.steer(features), scale_factor=2.0, mode="bilinear", align_corners=False
        )
        features = self.pixel(seen, steering, None, surroundings)
        features = functional.leaky_relu(self.mix(features), _SLOPE)
        colorfulness = (image.amax(1, keepdim=True) - image.amin(1, keepdim=True)) ** 2
        chromatic = colorfulness / (colorfulness + _NEUTRAL**2)
        change = proposal - image + self.residual(features) * severity[:, None, None, None]
        held = 1.0 - _SKIN_HELD * skin_likeness(image)[:, None]
        return change * chromatic * held


def channels_last(network: nn.Module) -> None:
    """Store convolution kernels as oneDNN wants them: on a CPU a third faster than torch's default order."""
    for value in network.parameters():
        if value.ndim == 4:
            value.data = value.data.contiguous(memory_format=torch.channels_last)


class _Normaliser:
    """Instance normalisation by given statistics or the images' own, layer after layer in the order of calls."""

    def __init__(self, active: bool, statistics: Statistics | None, record: Statistics | None) -> None:
        self._active, self._statistics, self._record, self._layer = active, statistics, record, 0

    def __call__(self, features: Tensor) -> Tensor:
        if not self._active:
            return features
        if self._statistics is None:
            variance, mean = torch.var_mean(features, (2, 3), correction=0, keepdim=True)
        else:
            mean, variance = self._statistics[self._layer]
        if self._record is not None:
            self._record[self._layer] = (mean, variance)
        self._layer += 1
        return (features - mean) * torch.rsqrt(variance + _EPSILON)


class _Modulated(nn.Module):
    """A convolution whose output channels are scaled and shifted by the steering vector, then rectified."""

    def __init__(self, convolution: nn.Conv2d, embedding: int) -> None:
        super().__init__()
        self.convolution = convolution
        self.modulate = nn.Linear(embedding, 2 * convolution.out_channels)
        nn.init.zeros_(self.modulate.weight)
        nn.init.zeros_(self.modulate.bias)

    def forward(
        self, features: Tensor, steering: Tensor, norm: _Normaliser | None, surroundings: Tensor | None = None
    ) -> Tensor:
        features = self.convolution(features)
        if norm is not None:
            features = norm(features)
        scale, shift = self.modulate(steering)[:, :, None, None].chunk(2, 1)
        if surroundings is not None:
            shift = shift + surroundings
        return functional.leaky_relu(torch.addcmul(shift, features, 1.0 + scale), _SLOPE)
