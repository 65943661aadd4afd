"""Going on with a run that was broken off: what its checkpoint says of it, and what to ask of the worker.

Standard library only.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from ... import __version__
from ..errors import InputError
from ..files.untrusted import explained, is_file, is_there, read_json
from ..runs.layout import (
    CHECKPOINT_CAPTURE_FILE,
    CHECKPOINT_FOLDER,
    CHECKPOINT_RUN_FILE,
    CHECKPOINT_STATE_FILE,
    REPORT_FILE,
)
from ..settings import OPTIONS, Settings, flag, typed_value
from .given import LAYERS, completed, completed_addition

CHECKPOINT_SECONDS = 120.0
"""Between two checkpoints: what a run that is killed loses at most."""

_LATER = ("blend", "turntable", "engine")  # options that may differ, because they concern what follows


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


def resumption(asked: Settings, given: Collection[str] | None = None) -> Resumption:
    """Whether `asked` goes on with a run that was broken off; else it adds layers, or starts anew.

    Options that are not given take the value that the run has, be it broken off or finished. Where there are both,
    ``--resume`` may mean either, and a run goes on only if `asked` has all of its values.

    Args:
        asked: with the default of options that are not given.
        given: names of those that are, with `given.LAYERS`; None: every one counts, but for adding layers those that
            have to be as in the finished run and are at their default.

    Raises:
        InputError: an option that is given has to be as in the finished run, and is not.
    """
    if not asked.resume:
        return Resumption(asked)
    own, note = _usable_checkpoint(asked, given)
    if own is not None:
        settings = completed(asked, own, OPTIONS if given is None else given)
        return Resumption(replace(settings, layers=own.layers, resume=False), continues=True)
    if not _is_finished(asked.out):
        return Resumption(replace(asked, resume=False) if note else asked, note=note)
    try:
        own = Settings.from_dict({**read_json(Path(asked.out) / REPORT_FILE)["settings"], "resume": False})
    except (KeyError, TypeError, InputError):
        return Resumption(asked, note=note)  # the worker says what is wrong with the report
    return Resumption(completed_addition(asked, own, given), note=note)


def goes_on(asked: Settings, given: Collection[str] | None = None) -> bool:
    """Whether `asked`, with ``resume``, goes on with a run that was broken off; `given`: as for `resumption`."""
    return _usable_checkpoint(asked, given)[0] is not None


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
    return replace(asked, resume=True) if goes_on(asked) else asked


def _is_finished(out: str) -> bool:
    return is_there(Path(out) / REPORT_FILE)


def _has_checkpoint(out: str | Path) -> bool:
    folder = checkpoint_folder(out)
    kept = any(is_file(folder / name) for name in (CHECKPOINT_CAPTURE_FILE, CHECKPOINT_STATE_FILE))
    return kept and is_file(folder / CHECKPOINT_RUN_FILE)


def _described(out: str | Path) -> tuple[str, Settings]:
    """Version and settings of the run whose checkpoint is in `out`."""
    described = read_json(checkpoint_folder(out) / CHECKPOINT_RUN_FILE)
    return described["version"], Settings.from_dict({**described["settings"], "resume": False})


def _usable_checkpoint(asked: Settings, given: Collection[str] | None) -> tuple[Settings | None, str]:
    """Settings of the run that was broken off, where `asked` can go on with it; else why its checkpoint is not used.

    The reason is "" where there is no checkpoint.
    """
    if not _has_checkpoint(asked.out):
        return None, ""
    compared = [name for name in (LAYERS, *OPTIONS) if name not in ("resume", *_LATER)]
    if given is not None and not _is_finished(asked.out):
        compared = [name for name in compared if name in given]
    try:
        version, own = _described(asked.out)
    except (KeyError, TypeError, InputError) as error:
        difference = f"is damaged{explained(error)}"
    else:
        other = next((name for name in compared if getattr(asked, name) != getattr(own, name)), "")
        if version == __version__ and not other:
            return own, ""
        difference = f"was made with another {'--cvd' if other == LAYERS else flag(other)}"
        if version != __version__:
            difference = f"was made by version {str(version)[:20]}"
    return None, f"the checkpoint of a run that was broken off here {difference}; it is not used"
