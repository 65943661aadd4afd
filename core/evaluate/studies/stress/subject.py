"""A capture at one level of an axis, as trials load it."""

from __future__ import annotations

from dataclasses import dataclass

from ..subject import CaptureFolder, Subject
from .axes import HARMLESS, Axis


@dataclass(frozen=True)
class StressedCapture:
    """A capture that something is wrong with; results are judged by what it would be if nothing were.

    Attributes:
        base: the capture.
        axis: what is wrong with it.
        level: how much.
        seed: of the directions that the mistakes take.
    """

    base: CaptureFolder
    axis: Axis
    level: int
    seed: int

    @property
    def name(self) -> str:
        return f"{self.base.name}-{self.axis.name}-{self.level}"

    @property
    def key(self) -> str:
        value = None if self.level == HARMLESS else self.axis.value(self.level)
        return repr((self.base.key, self.axis.name, value, self.seed))

    def load(self) -> Subject:
        return self.axis.apply(self.base.load(), self.level, self.seed)
