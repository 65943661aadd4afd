"""A capture as recipes are tried on it: what they are given, and what their results are judged by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from ...capture import Capture, read_capture
from ...settings import Settings
from ..evaluation import Split


@dataclass(frozen=True)
class Subject:
    """A capture, and the capture that its results are judged by.

    They are the same unless something is wrong with the given one on purpose.

    Attributes:
        given: with the views that are trained on.
        split: of `given`; its test views are for the curve and the product's own decisions.
        judged: with the views that figures are measured on.
        judged_split: of `judged`.
    """

    given: Capture
    split: Split
    judged: Capture
    judged_split: Split

    @classmethod
    def of(cls, capture: Capture, holdout: int = Settings.holdout) -> Subject:
        """The ordinary case: every `holdout`-th view of the capture is held out."""
        split = Split.every(len(capture.views), holdout)
        return cls(capture, split, capture, split)

    @property
    def is_ordinary(self) -> bool:
        """Whether results are judged by the capture that was given."""
        return self.judged is self.given


class SubjectSource(Protocol):
    """Where a subject comes from; small enough to be sent to another process.

    Attributes:
        name: what tables call it.
    """

    @property
    def name(self) -> str: ...

    @property
    def key(self) -> str:
        """Changes when the subject does; the same in every session."""
        ...

    def load(self) -> Subject:
        """Read it."""
        ...


@dataclass(frozen=True)
class CaptureFolder:
    """A capture in a folder.

    Attributes:
        name: what tables call it.
        folder: any capture that the product reads.
        max_size: longer side of the views in pixels.
        fitted_size: of the views that recipes are given, where they are judged by larger ones; None: the same.
    """

    name: str
    folder: Path
    max_size: int
    fitted_size: int | None = None

    @property
    def key(self) -> str:
        files = sorted(path for path in self.folder.rglob("*") if path.is_file())
        sizes = [(path.relative_to(self.folder).as_posix(), path.stat().st_size) for path in files]
        return repr((self.name, self.max_size, self.fitted_size, sizes))

    def load(self) -> Subject:
        judged = Subject.of(read_capture(self.folder, max_size=self.max_size))
        if self.fitted_size is None or self.fitted_size >= self.max_size:
            return judged
        given = Subject.of(read_capture(self.folder, max_size=self.fitted_size))
        return Subject(given.given, given.split, judged.judged, judged.judged_split)
