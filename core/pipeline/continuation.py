"""Going on with a run that was broken off: what its checkpoint says of it, and what to ask of the worker.

Standard library only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import InputError
from ..files.untrusted import explained, is_file, read_json
from ..runs.layout import (
    CHECKPOINT_CAPTURE_FILE,
    CHECKPOINT_FOLDER,
    CHECKPOINT_RUN_FILE,
    CHECKPOINT_STATE_FILE,
    REPORT_FILE,
)
from ..settings import OPTIONS, Settings, flag, typed_value

CHECKPOINT_SECONDS = 120.0
"""Between two checkpoints: what a run that is killed loses at most."""

_LATER = ("blend", "turntable", "engine")  # options that may change, because they concern what follows


@dataclass(frozen=True)
class CheckpointRequest:
    """Where a worker keeps checkpoints.

    Attributes:
        folder: for the latest one.
        resume: whether to go on from the one that is there.
        seconds: between two of them.
    """

    folder: str
    resume: bool = False
    seconds: float = CHECKPOINT_SECONDS

    def to_dict(self) -> dict[str, Any]:
        """A JSON-ready dictionary; `from_dict` reads it back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CheckpointRequest:
        """The request of `to_dict`.

        Raises:
            InputError: an unknown key, or a value of another type.
        """
        names = {entry.name for entry in fields(cls)}
        if not {"folder"} <= values.keys() <= names:
            raise InputError("the request for checkpoints is unusable", where="stdin", remedy="give their folder")
        return cls(**{name: typed_value(cls, name, value) for name, value in values.items()})


@dataclass(frozen=True)
class Resumption:
    """What ``--resume`` comes to.

    Attributes:
        settings: of the run; ``resume`` only where layers are added to a finished one.
        continues: whether it goes on from a checkpoint.
        note: why a checkpoint is not used; "" where there is none, or it is used.
    """

    settings: Settings
    continues: bool = False
    note: str = ""


def describe_run(settings: Settings) -> dict[str, Any]:
    """What a checkpoint says of its run, for `resumption`."""
    return {"version": __version__, "settings": settings.to_dict()}


def checkpoint_folder(out: str | Path) -> Path:
    """Where the run in `out` keeps its checkpoint."""
    return Path(out) / CHECKPOINT_FOLDER


def resumption(asked: Settings) -> Resumption:
    """Whether `asked` goes on with a run that was broken off; else it adds layers, or starts anew.

    Options that were left at their default take the value that the broken-off run has, unless there is a finished run,
    to which ``--resume`` may just as well mean to add a layer.
    """
    if not asked.resume:
        return Resumption(asked)
    finished = (Path(asked.out) / REPORT_FILE).exists()
    own, note = _usable_checkpoint(asked, exactly=finished)
    if own is not None:
        later = {name: getattr(asked, name) for name in _LATER}
        return Resumption(replace(own, capture=asked.capture, out=asked.out, **later), continues=True)
    return Resumption(replace(asked, resume=False) if note and not finished else asked, note=note)


def broken_off(out: str | Path) -> Settings | None:
    """What to ask for to go on with the run that was broken off in `out`; None where there is none that can."""
    if not _has_checkpoint(out):
        return None
    try:
        version, own = _described(out)
    except (KeyError, TypeError, InputError):
        return None
    return replace(own, out=str(out), resume=True) if version == __version__ else None


def continued(asked: Settings) -> Settings:
    """`asked`, every option of which counts, with ``resume`` where that goes on with a run that was broken off."""
    own, _ = _usable_checkpoint(asked, exactly=True)
    return asked if own is None else replace(asked, resume=True)


def _has_checkpoint(out: str | Path) -> bool:
    folder = checkpoint_folder(out)
    kept = any(is_file(folder / name) for name in (CHECKPOINT_CAPTURE_FILE, CHECKPOINT_STATE_FILE))
    return kept and is_file(folder / CHECKPOINT_RUN_FILE)


def _described(out: str | Path) -> tuple[str, Settings]:
    """Version and settings of the run whose checkpoint is in `out`."""
    described = read_json(checkpoint_folder(out) / CHECKPOINT_RUN_FILE)
    return described["version"], Settings.from_dict({**described["settings"], "resume": False})


def _usable_checkpoint(asked: Settings, *, exactly: bool) -> tuple[Settings | None, str]:
    """Settings of the run that was broken off, where `asked` can go on with it; else why its checkpoint is not used.

    The reason is "" where there is no checkpoint.
    """
    if not _has_checkpoint(asked.out):
        return None, ""
    try:
        version, own = _described(asked.out)
    except (KeyError, TypeError, InputError) as error:
        difference = f"is damaged{explained(error)}"
    else:
        difference = _difference(asked, own, exactly=exactly)
        if version != __version__:
            difference = f"was made by version {str(version)[:20]}"
        if not difference:
            return own, ""
    return None, f"the checkpoint of a run that was broken off here {difference}; it is not used"


def _difference(asked: Settings, own: Settings, *, exactly: bool) -> str:
    """What of `asked` is not as in `own`, or as usual, among what shapes a run; "" where nothing is."""
    usual = vars(own if exactly else Settings(asked.capture, asked.out))
    for name in ("layers", *OPTIONS):
        if name not in ("resume", *_LATER) and getattr(asked, name) not in (getattr(own, name), usual[name]):
            return f"was made with another {'--cvd' if name == 'layers' else flag(name)}"
    return ""
