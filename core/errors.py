"""The exceptions that reach a user. Standard library only: Blender's Python imports this."""

from __future__ import annotations

from pathlib import Path

MOST_CHARACTERS = 1200  # of a message; enough for three paths of 255 characters and what is said of them
MOST_VALUE_CHARACTERS = 40  # of a value that is quoted in one


class InputError(Exception):
    """Unusable arguments or input: one line that says what is wrong, where, and what to do. Exit code 2.

    Args:
        what: what is wrong, without a full stop ("the image is truncated").
        where: the file, folder or option concerned.
        remedy: what the user can do, as an imperative sentence without a full stop.
    """

    def __init__(self, what: str, *, where: str | Path = "", remedy: str = "") -> None:
        self.what = what
        self.where = str(where)
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        if self.remedy:
            text += f" - {self.remedy}"
        return one_line(text)


def one_line(text: str) -> str:
    """`text` as it may be shown anywhere: file names may contain anything, and a terminal obeys what it is shown.

    What does not print stands as its escape sequence, and of more than `MOST_CHARACTERS` the middle is left out.
    """
    if len(text) > MOST_CHARACTERS:
        end = MOST_CHARACTERS // 4
        text = f"{text[: MOST_CHARACTERS - end]} ... {text[-end:]}"
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def abbreviated(value: object) -> str:
    """`value` as Python writes it, in at most `MOST_VALUE_CHARACTERS`."""
    try:
        text = repr(value)
    except ValueError:  # Python writes no integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= MOST_VALUE_CHARACTERS else text[: MOST_VALUE_CHARACTERS - 3] + "..."


class Cancelled(BaseException):
    """The user asked to stop. Exit code 130. Not an `Exception`, so that no handler swallows it on the way up."""
