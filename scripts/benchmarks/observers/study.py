"""What a study shows, and the key that tells later which picture was which: its file is all that `analysis` needs.

Pictures are known to the page, and so to its answers, by codes that say nothing. Only the key has the methods, and it
stays with whoever made the study.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ....core.errors import InputError
from ....core.files.untrusted import read_json, writing_whole

FORMAT = "cvdgs-observers"
KEY_FILE = "observers-key.json"
STILL, TURNTABLE = "still", "turntable"
KINDS = (STILL, TURNTABLE)
QUESTIONS = {
    "visibility": "In which picture can you tell the colours apart more easily?",
    "naturalness": "Which picture looks more natural?",
}
REPEATED = 0.25
"""Share of the pairs of a question that are shown a second time, sides exchanged."""
_KEY_BYTES = 8 << 20
_CODE_BYTES = 4
_REMEDY = "name the folder in which the study was made (--out)"


@dataclass(frozen=True)
class Version:
    """One picture or turntable as a method made it.

    Attributes:
        method: its name in tables.
        frames: data URIs; one for a still.
        delta_e: mean ΔE00 to the original.
    """

    method: str
    frames: tuple[str, ...]
    delta_e: float


@dataclass(frozen=True)
class Stimulus:
    """What is shown in several versions.

    Attributes:
        cvd: the type that it was made for.
        kind: one of `KINDS`.
        name: of the photograph or scene.
    """

    cvd: str
    kind: str
    name: str
    versions: tuple[Version, ...]


@dataclass(frozen=True)
class Shown:
    """What a code stands for.

    Attributes:
        cvd, kind, name: of the stimulus.
        method, delta_e: of the version.
    """

    cvd: str
    kind: str
    name: str
    method: str
    delta_e: float

    @property
    def stimulus(self) -> tuple[str, str, str]:
        """Equal for versions of one stimulus."""
        return self.cvd, self.kind, self.name


@dataclass(frozen=True)
class Key:
    """The key of a study.

    Attributes:
        study: its identifier, which depends on all pictures.
        command: that made it, as texts show it.
        shown: by code.
    """

    study: str
    command: str
    shown: dict[str, Shown] = field(default_factory=dict)

    def methods(self, kind: str) -> list[str]:
        """The methods of a kind of stimulus, in their order."""
        return list(dict.fromkeys(item.method for item in self.shown.values() if item.kind == kind))

    @property
    def most_answers(self) -> int:
        """How many answers a participant can give at most: every pair of a type, repeated, to each question."""
        pairs: dict[str, int] = {}
        stimuli = [item.stimulus for item in self.shown.values()]
        for stimulus in set(stimuli):
            count = stimuli.count(stimulus)
            pairs[stimulus[0]] = pairs.get(stimulus[0], 0) + count * (count - 1) // 2
        return 2 * len(QUESTIONS) * max(pairs.values(), default=0)


def with_codes(stimuli: Sequence[Stimulus], command: str, seed: int) -> tuple[Key, list[tuple[Stimulus, list[str]]]]:
    """The key, and every stimulus with the codes of its versions.

    Args:
        stimuli: of all types.
        command: see `Key`.
        seed: of the codes.
    """
    rng = np.random.default_rng(seed)
    coded = [(stimulus, [rng.bytes(_CODE_BYTES).hex() for _ in stimulus.versions]) for stimulus in stimuli]
    shown = {
        code: Shown(stimulus.cvd, stimulus.kind, stimulus.name, version.method, round(version.delta_e, 3))
        for stimulus, codes in coded
        for code, version in zip(codes, stimulus.versions, strict=True)
    }
    frames = [version.frames for stimulus in stimuli for version in stimulus.versions]
    content = json.dumps([list(QUESTIONS.values()), {code: asdict(item) for code, item in shown.items()}, frames])
    return Key(hashlib.sha256(content.encode()).hexdigest()[:12], command, shown), coded


def write_key(folder: Path, key: Key) -> None:
    """Write the key into the folder of its study.

    Raises:
        InputError: the folder has the key of another study, which its answers need; or the file cannot be written.
    """
    path = folder / KEY_FILE
    if path.exists() and read_key(folder).study != key.study:
        remedy = "choose another folder, or remove the earlier study if nobody has answered it"
        raise InputError("this folder has the key of another study", where=path, remedy=remedy)
    values = {"format": FORMAT, **asdict(key)}
    with writing_whole(path) as file:
        file.write((json.dumps(values, indent=1) + "\n").encode())


def read_key(folder: Path) -> Key:
    """The key in the folder of a study.

    Raises:
        InputError: there is none, or it is damaged.
    """
    path = folder / KEY_FILE
    values = read_json(path, most_bytes=_KEY_BYTES, remedy=_REMEDY)
    try:
        return _key_of(values)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError("is not the key of a study", where=path, remedy=_REMEDY) from None


def _key_of(values: Any) -> Key:
    if values["format"] != FORMAT:
        raise ValueError
    shown = {str(code): Shown(**item) for code, item in values["shown"].items()}
    if not all(item.kind in KINDS and isinstance(item.method, str) for item in shown.values()):
        raise ValueError
    return Key(str(values["study"]), str(values["command"]), shown)
