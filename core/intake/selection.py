"""Which frames of videos become photographs: by how the picture moves, and of those that see the same the sharpest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .motion import Followed, Motion, motion_between

MOST_FRAMES = 150
"""Of all videos of a capture; more take SfM and training longer than they improve them."""

# What makes a frame worth having since the last one, in longer sides of the picture. Either the camera has moved enough
# for depths to be seen, or it has turned so far that a link of the chain would be missing.
_SHIFT = 0.13
_PARALLAX = 0.009
_LOST = 0.6
_EARLIEST, _LATEST = 0.7, 1.25  # of what is due: among the frames between these the sharpest is taken
_START = 0.3
_BLIND_SECONDS = 0.5  # between frames where no motion can be measured
_FINER = 0.5  # as often as that at most, in a video with little movement
_FEW = 24
_ATTEMPTS = 12


@dataclass(frozen=True)
class Frame:
    """One frame as it was seen while a video was looked through.

    Attributes:
        number: in order of the video.
        time: in seconds.
        sharpness: larger is sharper; compares frames that see the same.
        probe: the place in `Film.probes` of the points that are nearest to it in time.
    """

    number: int
    time: float
    sharpness: float
    probe: int


@dataclass(frozen=True)
class Film:
    """A video that was looked through: all its frames, and the points of some of them."""

    frames: Sequence[Frame]
    probes: Sequence[Followed]


def choose(films: Sequence[Film], most: int = MOST_FRAMES) -> list[list[Frame]]:
    """The frames to take of each film, in order; of all together not more than `most`.

    The same measure decides in all of them, and is made coarser until they are few enough.
    """
    spacing = 1.0
    for _ in range(_ATTEMPTS):
        chosen = [_walk(film, spacing) for film in films]
        count = sum(map(len, chosen))
        if count <= most:
            break
        spacing *= max(1.05, count / most)
    else:
        chosen = [_thinned(frames, count, most) for frames in chosen]
    if count < _FEW and spacing == 1.0:
        finer = [_walk(film, _FINER) for film in films]
        if sum(map(len, finer)) <= most:
            return finer
    return chosen


def worth(motion: Motion | None, seconds: float) -> float:
    """How much a second frame adds to a first, so many seconds later; from 1 on it is worth being a photograph."""
    if motion is None:
        return seconds / _BLIND_SECONDS
    return max(motion.shift / _SHIFT, motion.parallax / _PARALLAX, motion.lost / _LOST)


def _walk(film: Film, spacing: float) -> list[Frame]:
    """The sharpest frame wherever one is due since the last one."""
    if not film.frames:
        return []
    by_probe: list[list[Frame]] = [[] for _ in film.probes]
    for frame in film.frames:
        by_probe[frame.probe].append(frame)
    chosen = [_first(film, by_probe, spacing)]
    while True:
        last = chosen[-1].probe
        candidates: list[Frame] = []
        due = False
        for probe in range(last + 1, len(film.probes)):
            value = _worth(film, by_probe, last, probe) / spacing
            if value >= _LATEST and due:
                break
            if value >= _EARLIEST:
                candidates += by_probe[probe]
            due |= value >= 1.0
            if value >= _LATEST:
                break
        if not due or not candidates:
            return chosen
        chosen.append(max(candidates, key=lambda frame: frame.sharpness))


def _worth(film: Film, by_probe: Sequence[Sequence[Frame]], first: int, second: int) -> float:
    seconds = by_probe[second][0].time - by_probe[first][0].time
    return worth(motion_between(film.probes[first], film.probes[second]), seconds)


def _first(film: Film, by_probe: Sequence[Sequence[Frame]], spacing: float) -> Frame:
    """The sharpest before anything has moved much."""
    candidates: list[Frame] = []
    for probe, frames in enumerate(by_probe):
        if candidates and _worth(film, by_probe, 0, probe) > _START * spacing:
            break
        candidates += frames
    return max(candidates, key=lambda frame: frame.sharpness)


def _thinned(frames: list[Frame], count: int, most: int) -> list[Frame]:
    keep = max(1, len(frames) * most // count)
    return [frames[index] for index in np.unique(np.linspace(0, len(frames) - 1, keep).astype(int))]
