"""On which line of a TOML file each value stands, which `tomllib` does not tell. Standard library only."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import lru_cache

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
