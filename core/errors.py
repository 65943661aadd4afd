"""The exceptions that reach a user. Standard library only: Blender's Python imports this."""

from __future__ import annotations

from pathlib import Path


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
        # File names may contain anything, and the contract is one line.
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class Cancelled(BaseException):
    """The user asked to stop. Exit code 130. Not an `Exception`, so that no handler swallows it on the way up."""
