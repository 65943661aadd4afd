"""The state of a long computation as one file: nested values and arrays as safetensors with JSON. Never a pickle."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import DTypeLike, NDArray
from safetensors.torch import save_file

from ..errors import InputError
from .tensors import read_tensors
from .untrusted import parse_json, replacing

State = Mapping[str, Any]
"""By name: numpy arrays, what JSON can hold, and states."""

T = TypeVar("T")


class Restorable(Protocol):
    """Something whose state can be kept, and given to another one that was made alike."""

    def snapshot(self) -> State:
        """The state now."""

    def restore(self, saved: SavedState) -> None:
        """Take on a state; raises `InputError` where it is damaged."""


_VALUES = "values"  # the entry of the file's metadata that has what is no array


def write_state(path: Path, state: State, metadata: Mapping[str, str]) -> None:
    """Write `state` so that the file is there whole or not at all, also after a power cut.

    Args:
        metadata: is put beside it, and can be judged before the rest.

    Raises:
        OSError: the system refuses.
    """
    tensors = {name: torch.from_numpy(np.array(array, order="C")) for name, array in _arrays(state)}
    values = json.dumps(_without_arrays(state))
    with replacing(path) as temporary:
        save_file(tensors, temporary, {**metadata, _VALUES: values})
        with open(temporary, "rb+") as file:  # Windows waits only for a file that is open for writing
            os.fsync(file.fileno())


def read_state(path: Path, what: str, remedy: str, *, most_bytes: int) -> tuple[dict[str, str], SavedState]:
    """The metadata and the state of a file that somebody else may have made.

    Args:
        what: the file holds, for the message.
        remedy: what the user can do where it does not.
        most_bytes: that the file may have.

    Raises:
        InputError: it is not such a file, or damaged.
    """
    metadata, tensors = read_tensors(path, what, remedy, most_bytes=most_bytes)
    try:
        values = parse_json(metadata.pop(_VALUES, ""), strict=False)
        arrays = {name: tensor.numpy() for name, tensor in tensors.items()}
    except (ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"{what} is damaged ({error})", where=path, remedy=remedy) from None
    return metadata, SavedState(_Origin(path, what, remedy), values, arrays)


@dataclass(frozen=True)
class _Origin:
    path: Path
    what: str
    remedy: str


class SavedState:
    """A state out of a file, which hands out only what is as it is expected to be."""

    def __init__(self, origin: _Origin, values: Any, arrays: Mapping[str, NDArray], prefix: str = "") -> None:
        self._origin, self._prefix, self._arrays = origin, prefix, arrays
        self._values: Mapping[str, Any] = values if isinstance(values, dict) else self.refuse("has no values")

    def part(self, name: str) -> SavedState:
        """The state within this one; where it is not, an empty one."""
        return SavedState(self._origin, self._values.get(name, {}), self._arrays, f"{self._prefix}{name}.")

    def __contains__(self, name: str) -> bool:
        return name in self._values or f"{self._prefix}{name}" in self._arrays

    def value(self, name: str, kind: type[T]) -> T:
        """A value of exactly this type; whole numbers stand for others, too.

        Raises:
            InputError: it is missing, or something else.
        """
        value = self._values.get(name)
        if kind is float and type(value) is int:
            with contextlib.suppress(OverflowError):
                return float(value)  # type: ignore[return-value]
        return value if type(value) is kind else self.refuse(f"{name} is unusable")

    def number(self, name: str, least: int, most: int) -> int:
        """A whole number within limits.

        Raises:
            InputError: it is missing, something else, or outside of them.
        """
        value = self.value(name, int)
        return value if least <= value <= most else self.refuse(f"{name} is {str(value)[:20]}")

    def array(self, name: str, dtype: DTypeLike, *shape: int | None) -> NDArray[Any]:
        """A copy of an array of this type and shape; None stands for any length.

        Raises:
            InputError: it is missing, or another one.
        """
        found = self._arrays.get(f"{self._prefix}{name}")
        if found is None or found.dtype != np.dtype(dtype):
            return self.refuse(f"{name} is unusable")
        fits = len(found.shape) == len(shape)
        if not fits or any(b is not None and a != b for a, b in zip(found.shape, shape, strict=True)):
            return self.refuse(f"{name} has the shape {found.shape}")
        return found.copy()

    def refuse(self, why: str) -> NoReturn:
        """Say that the file cannot be used.

        Raises:
            InputError: always.
        """
        what = f"{self._origin.what} is damaged ({self._prefix}{why})"
        raise InputError(what, where=self._origin.path, remedy=self._origin.remedy)


def restore_random(rng: np.random.Generator, saved: SavedState, name: str) -> None:
    """Let `rng` go on from its ``bit_generator.state``; raises `InputError` where that is something else."""
    state = saved.value(name, dict)
    with contextlib.suppress(ValueError, TypeError, KeyError, OverflowError):
        rng.bit_generator.state = state
    if rng.bit_generator.state != state:  # it is something else, or has numbers that do not fit
        saved.refuse(f"{name} is unusable")


def _arrays(state: State, prefix: str = "") -> Iterator[tuple[str, NDArray]]:
    for name, value in state.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray):
            yield f"{prefix}{name}", value


def _without_arrays(state: State) -> dict[str, Any]:
    return {
        name: _without_arrays(value) if isinstance(value, Mapping) else value
        for name, value in state.items()
        if not isinstance(value, np.ndarray)
    }
