"""Damage to files: what copying, editing and malice do to them. Standard library only."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

# What readers stumble over, in binary and in text.
PAYLOADS: tuple[bytes, ...] = (
    b"\0",
    b"\xff",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x00\x80",
    b"\xff" * 8,
    b"\x00" * 8,
    (10**12).to_bytes(8, "little"),
    (2**62).to_bytes(8, "little"),
    b"\x00\x00\xc0\x7f",  # NaN
    b"\x00\x00\x80\x7f",  # infinity
    b"\x00\x00\x00\x00\x00\x00\xf8\x7f",
    b"\x00\x00\x00\x00\x00\x00\xf0\x7f",
    b"nan",
    b"NaN",
    b"-inf",
    b"Infinity",
    b"1e999",
    b"-1",
    b"0",
    b"1000000000000",
    b"9" * 30,
    b"9" * 5000,
    b"../../../etc/passwd",
    b"/etc/passwd",
    b"C:\\x.png",
    b"\\ud800",
    b"\\u0000",
    b"\n",
    b"\r",
    b"\x1b[2J",
    "\U0001f9f5".encode(),
    b"\xf0\x28\x8c\x28",  # no UTF-8
    b" ",
    b'"',
    b"{",
    b"[" * 2000,
    b"]",
    b",",
    b":",
    b"null",
    b"true",
    b"{}",
    b"[]",
    b"a." * 200,
    b"=",
    b"#",
)
_MOST_MOVED = 64  # bytes


@dataclass(frozen=True)
class Edit:
    """One change.

    Attributes:
        kind: of `KINDS`.
        place: where, as a share of the file's length in [0, 1].
        other: another place, for a copy.
        size: bytes that are taken, put or copied.
        payload: index into `PAYLOADS`.
        value: a byte.
    """

    kind: str
    place: float
    other: float
    size: int
    payload: int
    value: int


KINDS = ("byte", "bit", "overwrite", "insert", "delete", "copy", "repeat", "cut")


def edited(data: bytes, edits: Sequence[Edit]) -> bytes:
    """`data` after all `edits`, in order."""
    for edit in edits:
        data = _edited(data, edit)
    return data


def _edited(data: bytes, edit: Edit) -> bytes:
    start, other = int(edit.place * len(data)), int(edit.other * len(data))
    size = 1 + edit.size % _MOST_MOVED
    payload = PAYLOADS[edit.payload % len(PAYLOADS)]
    if edit.kind == "byte":
        return data[:start] + bytes([edit.value]) + data[start + 1 :]
    if edit.kind == "bit":
        flipped = (data[start] if start < len(data) else 0) ^ (1 << edit.value % 8)
        return data[:start] + bytes([flipped]) + data[start + 1 :]
    if edit.kind == "overwrite":
        return data[:start] + payload + data[start + len(payload) :]
    if edit.kind == "insert":
        return data[:start] + payload + data[start:]
    if edit.kind == "delete":
        return data[:start] + data[start + size :]
    if edit.kind == "copy":
        return data[:start] + data[other : other + size] + data[start + size :]
    if edit.kind == "repeat":
        return data[:start] + data[start : start + size] * 3 + data[start + size :]
    return data[:start]


def random_edits(generator: random.Random) -> list[Edit]:
    """One to six edits."""
    return [
        Edit(
            generator.choice(KINDS),
            generator.random(),
            generator.random(),
            generator.randrange(_MOST_MOVED),
            generator.randrange(len(PAYLOADS)),
            generator.randrange(256),
        )
        for _ in range(generator.choice((1, 1, 1, 2, 3, 6)))
    ]
