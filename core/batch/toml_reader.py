"""Reads a table of a TOML file value by value, and collects everything that is wrong with it. Standard library only."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path as FilePath
from typing import Any, TypeVar

from ..errors import InputError, one_line

_Value = TypeVar("_Value")
_MOST_NAMES = 100  # in a list
_MOST_LINES = 100  # that are said of an unusable file


@dataclass(frozen=True, order=True)
class Problem:
    """Something wrong in a file.

    Attributes:
        line: where, counted from 1.
        text: which value, what is wrong, what to do.
    """

    line: int
    text: str


class UnusableFile(InputError):
    """A file with one problem or many; the text has a line for each of them.

    Attributes:
        problems: by their lines.
    """

    def __init__(self, file: FilePath, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(set(problems)))
        self._file = file
        super().__init__(f"{len(self.problems)} problems", where=file)

    def lines(self) -> Iterator[str]:
        """A problem each: file, line, what is wrong, what to do."""
        for problem in self.problems[:_MOST_LINES]:
            yield one_line(f"{self._file}, line {problem.line}: {problem.text}")
        if len(self.problems) > _MOST_LINES:
            yield one_line(f"{self._file}: {len(self.problems) - _MOST_LINES} more problems")

    def __str__(self) -> str:
        return "\n".join(self.lines())


@dataclass
class Problems:
    """Collects the problems of a file.

    Attributes:
        source: the file's text, whose lines are counted as soon as there is a problem.
        found: so far.
    """

    source: str
    found: list[Problem] = field(default_factory=list)

    @cached_property
    def _lines(self) -> LineNumbers:
        return LineNumbers(self.source)

    def add(self, path: Path, what: str, remedy: str = "") -> None:
        """Note that the value at `path` is unusable."""
        name = _shown(path)
        text = f"{name}: {what}" if name else what
        self.found.append(Problem(self._lines[path], f"{text} - {remedy}" if remedy else text))


class TableReader:
    """One table. Every reader returns the default where the value is missing or unusable, and notes what is wrong.

    Args:
        values: of the table.
        path: of the table in the file.
        problems: receives what is wrong.
    """

    def __init__(self, values: Mapping[str, Any], path: Path, problems: Problems) -> None:
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
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
        if not is_number or not low <= value <= high:
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
            self.add(key, f"'{', '.join(repeated)}' is there twice", "name each once")
        return tuple(dict.fromkeys(value))

    def choices(self, key: str, default: tuple[str, ...], allowed: Sequence[str]) -> tuple[str, ...]:
        """A list of some of `allowed`."""
        names = self.names(key, default)
        for index, name in enumerate(names):
            if name not in allowed:
                self.problems.add((*self.path, key, index), f"'{name}' is not known", _suggest(name, allowed))
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
        self.problems.add((*self.path, key), what, remedy)

    def refuse_others(self, allowed: Sequence[str] = ()) -> None:
        """Note every key that was not asked for, and is not one of `allowed`."""
        known = [*self._known, *allowed]
        for key in self.values:
            if key not in known:
                self.add(key, "is not known here", _suggest(key, known))

    def _get(self, key: str, default: Any) -> Any:
        self._known.append(key)
        return self.values.get(key, default)

    def _refuse(self, key: str, default: _Value, remedy: str) -> _Value:
        self.add(key, f"{_abbreviated(self.values[key])} is unusable", remedy)
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


def _abbreviated(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


Path = tuple[str | int, ...]
"""Keys and indices from the document down to a value: ``("items", 2, "turntable", "frames")``."""

_TOKEN = re.compile(
    r"""
      (?P<space>[ \t\r]+|\#[^\n]*)
    | (?P<newline>\n)
    | (?P<string>\"{3}(?:\\.|[^\\])*?\"{3}\"{0,2} | '{3}.*?'{3}'{0,2} | "(?:\\.|[^"\\\n])*" | '[^'\n]*')
    | (?P<mark>[\[\]{},=])
    | (?P<bare>[^\s\[\]{},=\#"']+)
    """,
    re.VERBOSE | re.DOTALL,
)


class LineNumbers:
    """Line numbers, counted from 1, of the values of a document.

    Args:
        text: a valid TOML document.
    """

    def __init__(self, text: str) -> None:
        self._lines: Mapping[Path, int] = _Scanner(text).lines

    def __getitem__(self, path: Path) -> int:
        """Where the value at `path` is set; for one that is not set, where what it belongs to begins."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)


class _Scanner:
    """Walks through a document that is known to be valid, and notes where values begin."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self._tokens = _tokens(text)
        self._position = 0
        self._counts: dict[Path, int] = {}  # tables so far of each array of tables
        table: Path = ()
        while (token := self._skip_newlines()) is not None:
            if token == "[":
                table = self._header()
            else:
                self._pair(table)

    def _skip_newlines(self) -> str | None:
        while (token := self._peek()) == "\n":
            self._position += 1
        return token

    def _peek(self) -> str | None:
        return self._tokens[self._position][0] if self._position < len(self._tokens) else None

    def _take(self) -> tuple[str, int]:
        token = self._tokens[self._position]
        self._position += 1
        return token

    def _header(self) -> Path:
        _, line = self._take()
        is_array = self._peek() == "["
        if is_array:
            self._take()
        keys = _keys(self._until("]"))
        for _ in range(2 if is_array else 1):
            self._take()
        path: Path = ()
        for key in keys[:-1]:
            path = self._latest((*path, key))
        path = (*path, keys[-1])
        if is_array:
            self._counts[path] = self._counts.get(path, 0) + 1
            self._note(path, line)
        path = self._latest(path)
        self._note(path, line)
        return path

    def _latest(self, path: Path) -> Path:
        """`path`, or the last table there where it is an array of tables."""
        return (*path, self._counts[path] - 1) if path in self._counts else path

    def _pair(self, table: Path) -> None:
        line = self._tokens[self._position][1]
        path = table
        for key in _keys(self._until("=")):
            path = (*path, key)
            self._note(path, line)
        self._take()
        self._value(path)

    def _value(self, path: Path) -> None:
        opening = self._peek()
        if opening == "[":
            self._take()
            index = 0
            while self._skip_newlines() != "]":
                if self._peek() == ",":
                    self._take()
                    continue
                self._note((*path, index), self._tokens[self._position][1])
                self._value((*path, index))
                index += 1
            self._take()
        elif opening == "{":
            self._take()
            while self._skip_newlines() != "}":
                if self._peek() == ",":
                    self._take()
                else:
                    self._pair(path)
            self._take()
        else:
            while self._peek() not in (None, "\n", ",", "]", "}"):  # a date and its time are two tokens
                self._take()

    def _until(self, mark: str) -> str:
        """The text of the tokens before the next `mark`, which stays."""
        parts = []
        while self._peek() != mark:
            parts.append(self._take()[0])
        return "".join(parts)

    def _note(self, path: Path, line: int) -> None:
        self.lines.setdefault(path, line)


def _tokens(text: str) -> list[tuple[str, int]]:
    """What the document consists of, each with its line; without spaces and comments."""
    found, line = [], 1
    for match in _TOKEN.finditer(text):
        if match.lastgroup != "space":
            found.append((match.group(), line))
        line += match.group().count("\n")
    return found


@lru_cache(maxsize=256)
def _keys(text: str) -> tuple[str, ...]:
    """The keys of a dotted key."""
    keys, value = [], tomllib.loads(f"{text} = 0")
    while isinstance(value, dict):
        ((key, value),) = value.items()
        keys.append(key)
    return tuple(keys)
