"""What the process that estimates cameras is asked for, and what it answers: plain values, as JSON between the two."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field

from ..runtime.time_model import TIME_MODEL

DATABASE = "database.db"
RESULT = "result"
REFUSAL = "refusal"  # the key of a last message with what, where and remedy of an `InputError`


@dataclass(frozen=True)
class SfmSettings:
    """What trades time for completeness.

    Attributes:
        max_image_size: longer side in pixels at which features are sought; COLMAP's "medium" quality.
        max_features: for each photograph.
        exhaustive_limit: up to this many photographs every pair is matched; above, each with its neighbours in order
            of their names, as a walk around the scene or a video gives them, and with those that look most like it.
        sequential_overlap: number of neighbours, besides those at distances of powers of two.
        alike: number of photographs that look most like one and are matched with it, as where a walk closes.
        camera_model: while photographs are placed. One focal length, because two cannot be told apart where
            the camera is only carried around something: of the demo, taken on an arc, they came out as 485 and 749
            pixels and not as 480. One number of distortion, because more take up what a guessed focal length leaves,
            and then no third photograph fits the first two: of a street, 2 of 29 were placed instead of 27.
        refined_model: at the end, when all photographs hold it; suits phones and cameras with ordinary lenses.
        min_model_size: photographs; a capture of two is still one.
        enough: share of the photographs after which no further way of placing them is tried.
        threads: for features and matching.
        seed: of RANSAC and the mappers.
        first: what is tried before; None for nothing.
    """

    max_image_size: int = 1600
    max_features: int = 4096
    exhaustive_limit: int = 80
    sequential_overlap: int = 10
    alike: int = 10
    camera_model: str = "SIMPLE_RADIAL"
    refined_model: str = "RADIAL"
    min_model_size: int = 2
    enough: float = 0.9
    threads: int = 2
    seed: int = 0
    first: SfmSettings | None = None

    @classmethod
    def for_views(cls, size: int | None) -> SfmSettings:
        """What suits a scene that is fitted to pictures of `size` pixels, None for the photographs' own size.

        Drafts are content with smaller photographs, fewer features and fewer pairs, where these place enough.
        """
        return cls(first=_QUICK) if size is not None and size <= _DRAFT else cls()

    def matches_every_pair(self, count: int) -> bool:
        """Whether `count` photographs are few enough to match each with each."""
        return count <= self.exhaustive_limit

    def pairs(self, count: int) -> int:
        """The most pairs that are matched among `count` photographs."""
        if self.matches_every_pair(count):
            return count * (count - 1) // 2
        return sum(max(count - distance, 0) for distance in self.distances) + self.alike * count

    def seconds(self, count: int, width: int, height: int) -> float:
        """Of estimating the cameras of `count` photographs on the reference machine, if the first try is enough."""
        tried = self.first or self
        pixels = min(width * height, tried.max_image_size**2)
        return TIME_MODEL.estimation(count, pixels / 1e6, tried.pairs(count))

    @property
    def distances(self) -> tuple[int, ...]:
        """Of neighbours that are matched, in the order in which the photographs were taken."""
        powers = {2**exponent for exponent in range(self.sequential_overlap)}
        return tuple(sorted({*range(1, self.sequential_overlap + 1), *powers}))


_DRAFT = 400  # pixels
# docs/faq.md has what it costs and saves.
_QUICK = SfmSettings(max_image_size=1000, max_features=3072, exhaustive_limit=30)


@dataclass(frozen=True)
class SfmJob:
    """What to do.

    Attributes:
        folder: holds the photographs.
        names: of the photographs, in the order in which they were taken.
        cameras: for each of them the number of the camera that took it, counted from 0.
        workspace: an empty folder for database and result.
        settings: see there.
        masks: files that say what of a photograph is looked at, by its name.
    """

    folder: str
    names: list[str]
    cameras: list[int]
    workspace: str
    settings: SfmSettings
    masks: dict[str, str] = field(default_factory=dict)

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> SfmJob:
        fields = json.loads(text)
        settings = fields["settings"]
        first = settings["first"] and SfmSettings(**settings["first"])
        return cls(**{**fields, "settings": SfmSettings(**{**settings, "first": first})})


@dataclass(frozen=True)
class Placed:
    """What came of a job.

    Attributes:
        names: of the photographs that have a place, in the job's order; those of the largest piece.
        pieces: number of photographs in each piece that hangs together, largest first.
        lenses: for each camera with a placed photograph its focal length as a multiple of the longer side.
        matched: for each photograph the number of others with which it has enough in common.
        method: "global", "incremental" or "pieces" (of either, joined).
    """

    names: list[str] = field(default_factory=list)
    pieces: list[int] = field(default_factory=list)
    lenses: list[float] = field(default_factory=list)
    matched: list[int] = field(default_factory=list)
    method: str = ""

    def to_dict(self) -> dict:
        return asdict(self)
