"""One thing that a run needs or can use: whether it is here, and else how to get it. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ..errors import InputError


class State(Enum):
    """How a thing stands; the values are what programs read and what stands before a line."""

    OK = "ok"
    NOTE = "note"
    """It is missing or scarce, and the main job runs all the same."""
    MISSING = "missing"


@dataclass(frozen=True)
class Finding:
    """A line of the doctor.

    Attributes:
        name: of the thing.
        state: whether it is here.
        found: what was found, or what is wrong.
        remedy: how to get it, as an imperative sentence without a full stop; empty where nothing has to be done.
    """

    name: str
    state: State
    found: str
    remedy: str = ""

    @classmethod
    def of_error(cls, name: str, error: InputError) -> Finding:
        """What is missing because of `error`."""
        found = f"{error.where}: {error.what}" if error.where else error.what
        return cls(name, State.MISSING, found, error.remedy)

    def to_dict(self) -> dict[str, str]:
        """A JSON-ready dictionary."""
        return {"name": self.name, "state": self.state.value, "found": self.found, "remedy": self.remedy}
