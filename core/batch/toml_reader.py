"""Reads a table of a TOML file value by value and collects everything that is wrong with it. Standard library only."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, TypeVar

from ..errors import InputError, abbreviated, one_line

_Value = TypeVar("_Value")
Path = tuple[str | int, ...]
"""Keys and indices from the document down to a value: ``("items", 2, "turntable", "frames")``."""

_MOST_NAMES = 100  # in a list
_MOST_LINES = 100  # printed about an unusable file


class UnusableFile(InputError):
    """A file with one problem or many; the text has a line for each of them.

    Attributes:
        problems: each with the value concerned, what is wrong, and what to do.
    """

    def __init__(self, file: FilePath, problems: Iterable[str]) -> None:
        self.problems = tuple(dict.fromkeys(problems))
        self._file = file
        super().__init__(f"{len(self.problems)} problems", where=file)

    def lines(self) -> Iterator[str]:
        """One line for each problem: the file, the value, what is wrong, what to do."""
        for problem in self.problems[:_MOST_LINES]:
            yield one_line(f"{self._file}: {problem}")
        if len(self.problems) > _MOST_LINES:
            yield one_line(f"{self._file}: {len(self.problems) - _MOST_LINES} more problems")

    def __str__(self) -> str:
        return "\n".join(self.lines())


class TableReader:
    """One table. Every reader returns the default where the value is missing or unusable, and notes what is wrong.

    Args:
        values: of the table.
        path: of the table in the file.
        problems: receives a line for everything that is wrong.
    """

    def __init__(self, values: Mapping[str, Any], path: Path, problems: list[str]) -> None:
        self.values, self.path, self.problems = values, path, problems
        self._known: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def integer(self, key: str, default: int, low: int, high: int) -> int:
        """A whole number from `low` to `high`."""
        value = self._get(key, default)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            return self._refuse(key, default, f"give a whole number from {low} to {high}")
        return value

    def number(self, key: str, default: float, low: float, high: float) -> float:
        """A number from `low` to `high`."""
        value = self._get(key, default)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:  # NaN is in no range
            return self._refuse(key, default, f"give a number from {low:g} to {high:g}")
        return float(value)

    def pair_of_integers(self, key: str, default: tuple[int, int], low: int, high: int) -> tuple[int, int]:
        """Two whole numbers from `low` to `high`."""
        value = self._get(key, list(default))
        if not isinstance(value, list) or [type(entry) for entry in value] != [int, int]:
            return self._refuse(key, default, "give two whole numbers, such as [640, 480]")
        if not all(low <= entry <= high for entry in value):
            return self._refuse(key, default, f"give numbers from {low} to {high}")
        return value[0], value[1]

    def text(self, key: str, default: str = "") -> str:
        """Text that is not empty."""
        value = self._get(key, default)
        if key in self.values and (not isinstance(value, str) or not value.strip()):
            return self._refuse(key, default, "give text in quotation marks")
        return value

    def names(self, key: str, default: tuple[str, ...]) -> tuple[str, ...]:
        """A list of different texts; at least one."""
        value = self._get(key, list(default))
        if key not in self.values:
            return default
        if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
            return self._refuse(key, default, 'give a list of texts, such as ["one", "two"]')
        if len(value) > _MOST_NAMES:
            return self._refuse(key, default, f"give at most {_MOST_NAMES}")
        repeated = sorted(name for name, count in Counter(value).items() if count > 1)
        if repeated:
            self.add(key, f"'{', '.join(repeated)}' appears twice", "name each once")
        return tuple(dict.fromkeys(value))

    def choices(self, key: str, default: tuple[str, ...], allowed: Sequence[str]) -> tuple[str, ...]:
        """A list of some of `allowed`."""
        names = self.names(key, default)
        for index, name in enumerate(names):
            if name not in allowed:
                self.add_at((key, index), f"unknown name '{name}'", _suggest(name, allowed))
        return tuple(name for name in names if name in allowed) or default

    def table(self, key: str) -> TableReader:
        """A table inside this one; empty where it is missing."""
        value = self._get(key, {})
        if not isinstance(value, dict):
            value = self._refuse(key, {}, f"write it as a table, [{_shown((*self.path, key))}]")
        return TableReader(value, (*self.path, key), self.problems)

    def tables(self, key: str) -> list[TableReader]:
        """An array of tables; empty where it is missing."""
        value = self._get(key, [])
        if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
            value = self._refuse(key, [], f"write every entry as [[{_shown((*self.path, key))}]]")
        return [TableReader(entry, (*self.path, key, index), self.problems) for index, entry in enumerate(value)]

    def add(self, key: str, what: str, remedy: str = "") -> None:
        """Note that the value of `key` is unusable."""
        self.add_at((key,), what, remedy)

    def add_at(self, place: Path, what: str, remedy: str = "") -> None:
        """Note that the value at `place` in this table is unusable; an empty place means the table itself."""
        text = ": ".join(filter(None, (_shown((*self.path, *place)), what)))
        self.problems.append(f"{text} - {remedy}" if remedy else text)

    def refuse_others(self, allowed: Sequence[str] = ()) -> None:
        """Note every key that was not asked for, and is not one of `allowed`."""
        known = [*self._known, *allowed]
        for key in self.values:
            if key not in known:
                self.add(key, "unknown key", _suggest(key, known))

    def _get(self, key: str, default: Any) -> Any:
        self._known.append(key)
        return self.values.get(key, default)

    def _refuse(self, key: str, default: _Value, remedy: str) -> _Value:
        self.add(key, f"{abbreviated(self.values[key])} cannot be used", remedy)
        return default


def _suggest(name: str, allowed: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, allowed, n=1)
    return f"did you mean '{close[0]}'?" if close else "use " + ", ".join(allowed)


def _shown(path: Path) -> str:
    """``items[3].turntable.frames``; entries of arrays are counted from 1, as people do."""
    text = ""
    for part in path:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text
