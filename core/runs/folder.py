"""The output folder of a run: staged, and put in place only when it is complete. Standard library only.

A run writes into ``OUT/.partial`` (same file system, so that moving is a rename). `RunFolder.commit` replaces what an
earlier run left; `RunFolder.abort` removes every trace. A lock on ``OUT/.lock`` keeps two runs apart and vanishes with
the process that holds it.

A process that is killed while it puts its results in place leaves one of two states, which the next run mends: before
``.partial`` was renamed to ``.complete``, the earlier result goes back from ``.replaced``; after that, the new one is
moved in place to the end.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO

from ..errors import InputError
from ..files.untrusted import is_encodable
from . import layout
from .report import is_run

_STAGING = ".partial"
_COMPLETE = ".complete"
_RETIRED = ".replaced"
_LOCK = ".lock"

# What a system says of a lock that somebody else holds; anything else means that it cannot lock files there.
_HELD = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)


def files_of_a_run(out: Path) -> list[Path]:
    """What an earlier run of scripts/run.py may have left in `out`, whether it is there or not.

    Raises:
        InputError: something is there under such a name, but no run's report: it is the user's own.
    """
    files = [out / name for name in layout.NAMES]
    files += [path for name_of in layout.LAYER_FILES for path in layout.files_by_layer(out, name_of).values()]
    if not is_run(out):
        refuse_foreign_files(files)
    return files


def remove_layer(folder: Path, layer: str) -> None:
    """Delete what the run in `folder` still has of a layer whose Gaussians were lost, before it is made again.

    It may be made with other options, by which not every file is written anew: turntables, another enhancer's files.
    """
    for name in (layout.ENHANCED_FOLDER, layout.RENDERS_FOLDER, layout.TURNTABLE_FOLDER):
        remove_folder(folder / name / layer)
    for name in (layout.layer_cube_file(layer), layout.layer_network_file(layer), layout.layer_still_file(layer)):
        (folder / name).unlink(missing_ok=True)


def remove_folder(folder: Path) -> None:
    """Delete `folder`, or the link in its place, through which what is written there would land elsewhere."""
    if folder.is_symlink():
        folder.unlink()
    else:
        shutil.rmtree(folder, ignore_errors=True)


def refuse_foreign_files(files: Iterable[Path]) -> None:
    """For a folder without a sign of an earlier job: refuse to replace any of `files`.

    Raises:
        InputError: one is there.
    """
    found = next((path for path in files if os.path.lexists(path)), None)
    if found is not None:
        remedy = "choose another folder with --out, or move it away"
        raise InputError("already exists and was not made by an earlier run", where=found, remedy=remedy)


class RunFolder:
    """Owns the output folder for the time of one run.

    Args:
        out: the folder; made when it is missing.
        earlier_files: what an earlier run has left in a folder, and a new one replaces; raises InputError where it is
            somebody else's. Nothing else there is touched.
        last: the staged file that marks the others as complete, and so is put in place after them.

    Attributes:
        out: the folder.
        staging: where the run writes.
        mended: what was done about an earlier run that was killed while it put its results in place; "" if nothing.

    Raises (on construction):
        InputError: the folder cannot be made or written, its path is not UTF-8, another run is using it, or it holds
            what no run has made.
    """

    def __init__(
        self,
        out: str | Path,
        earlier_files: Callable[[Path], list[Path]] = files_of_a_run,
        last: str = layout.REPORT_FILE,
    ) -> None:
        self.out = Path(out).absolute()
        self._earlier_files, self._last = earlier_files, last
        self._created: list[Path] = []
        self.staging = self.out / _STAGING
        self._complete, self._retired = self.out / _COMPLETE, self.out / _RETIRED
        self._lock: IO[str] | None = None
        if not is_encodable(str(self.out)):  # what writes pictures would fail, after all the work
            remedy = "rename the folder, or choose another one with --out"
            raise InputError("its path is not UTF-8", where=out, remedy=remedy)
        try:
            self._created = [path for path in (self.out, *self.out.parents) if not path.exists()]
            self.out.mkdir(parents=True, exist_ok=True)
            self._lock = self._take_lock()
            for path in (self.staging, self._complete, self._retired, self.out / layout.CHECKPOINT_FOLDER):
                if path.is_symlink():  # no run makes one, and what it leads to is not ours to move or remove
                    path.unlink()
            self.mended = self._mend()
            self._earlier_files(self.out)
            shutil.rmtree(self.staging, ignore_errors=True)
            self.staging.mkdir()
        except BaseException as error:
            self.abort()
            if not isinstance(error, OSError):
                raise
            raise InputError(
                f"cannot be written to ({error.strerror})", where=out, remedy="choose another folder with --out"
            ) from None

    def _take_lock(self) -> IO[str]:
        path = self.out / _LOCK
        while True:
            lock = open_lock(path)
            try:
                lock_exclusively(lock)
                # The run that held it may have removed the file meanwhile; a lock on that keeps nobody out.
                if path.exists() and os.path.samestat(os.fstat(lock.fileno()), path.stat()):
                    return lock
            except OSError as error:
                lock.close()
                if not is_held(error):
                    raise
                raise InputError(
                    "another run is writing here",
                    where=self.out,
                    remedy="wait for it, or choose another folder with --out",
                ) from None
            lock.close()

    def _mend(self) -> str:
        """Bring a `commit` that was cut short to one of its ends; returns what that was."""
        if self._complete.is_dir():
            for path in self._in_order(self._complete):
                os.replace(path, self.out / path.name)
            self._end_commit()
            return "an earlier run was interrupted while it put its results in place; they are now complete"
        if self._retired.is_dir():
            for path in self._in_order(self._retired):
                os.replace(path, self.out / path.name)
            self._retired.rmdir()
            return "an earlier run was interrupted while it replaced a result; that result was restored"
        return ""

    def carry_over(self, source: Path | None = None) -> None:
        """Copy what an earlier run left into the staging folder, for a run that adds to it.

        Args:
            source: the earlier run's folder; None: this one.

        Raises:
            OSError: they could not be copied whole.
        """
        for path in self._earlier_files(source or self.out):
            if path.is_dir():
                _copy_folder(path, self.staging / path.name)
            elif path.is_file():
                _copy_file(path, self.staging / path.name, follow_symlinks=True)

    def commit(self) -> None:
        """Replace an earlier run's files by the staged ones: each is a rename, and the old ones are deleted last.

        Raises:
            OSError: that is not possible; all is as it was before.
            InputError: likewise, because what would be replaced is not an earlier run's.
        """
        staged = self._in_order(self.staging)
        earlier = {path.name for path in (*self._earlier_files(self.out), *staged) if (self.out / path.name).exists()}
        if earlier:
            _write_through(self.staging)  # a power cut must not find the old files gone and the new ones empty
            self._retired.mkdir()
        # The file that marks the others as complete is taken away first and put in place last.
        names = sorted(earlier, key=lambda name: name != self._last)
        moves = [(self.out / name, self._retired / name) for name in names]
        moves.append((self.staging, self._complete))
        moves += [(self._complete / path.name, self.out / path.name) for path in staged]
        begun: list[tuple[Path, Path]] = []
        try:
            for source, target in moves:
                begun.append((source, target))
                os.replace(source, target)
        except BaseException:
            self._undo(begun)
            raise
        self._end_commit()
        self._release()

    def _undo(self, moves: list[tuple[Path, Path]]) -> None:
        """Take `moves` back, of which the last one may not have been made."""
        for source, target in reversed(moves):
            if not source.exists():
                os.replace(target, source)
        with contextlib.suppress(OSError):
            self._retired.rmdir()

    def _end_commit(self) -> None:
        """Remove what a commit has replaced. What is still in ``.replaced`` without ``.complete`` would be put back."""
        if self._retired.is_dir():
            os.replace(self._retired, self.staging)
        self._complete.rmdir()
        shutil.rmtree(self.staging, ignore_errors=True)

    def _in_order(self, folder: Path) -> list[Path]:
        """What is in `folder`, the file that marks the others as complete at the end."""
        return sorted(folder.iterdir(), key=lambda path: (path.name == self._last, path.name))

    def abort(self, keep: str = "") -> Path | None:
        """Remove what was staged and any folder that was made for it.

        Args:
            keep: a staged file to keep as ``OUT/failed.<name>`` (the log of a run that met a defect).

        Returns:
            Where the kept file is, or None.
        """
        kept = None
        if self._lock is not None:  # else the staging folder is another run's
            source = self.staging / keep
            if keep and source.is_file():
                kept = self.out / f"failed.{keep}"
                os.replace(source, kept)
            shutil.rmtree(self.staging, ignore_errors=True)
            self._release()
        self._remove_created()
        return kept

    def _release(self) -> None:
        if self._lock is not None:
            with contextlib.suppress(OSError):  # Windows removes no open file; an old lock file does no harm
                (self.out / _LOCK).unlink(missing_ok=True)  # while it is held, or it might be the next run's
            self._lock.close()
            self._lock = None

    def _remove_created(self) -> None:
        for path in self._created:
            with contextlib.suppress(OSError):  # not empty, or never made
                path.rmdir()


def _copy_folder(source: Path, target: Path) -> None:
    """Copy `source` to `target`, with links as links: a run has none, and cycles end there.

    Raises:
        OSError: what the system refused first; `shutil.copytree` goes on and keeps the reasons as texts alone.
    """
    target.mkdir()
    with os.scandir(source) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                _copy_folder(Path(entry.path), target / entry.name)
            else:
                _copy_file(Path(entry.path), target / entry.name, follow_symlinks=False)


def _copy_file(source: Path, target: Path, *, follow_symlinks: bool) -> None:
    """Copy a file so that the copy can be written to: what was published may be read-only."""
    shutil.copy2(source, target, follow_symlinks=follow_symlinks)
    if not target.is_symlink():
        target.chmod(target.stat().st_mode | stat.S_IWUSR)


def open_lock(path: Path) -> IO[str]:
    """The lock file `path`, made where it is missing, and never what a link in its place leads to.

    Raises:
        OSError: it is a link, a folder, or cannot be made.
    """
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    return open(path, "w", opener=lambda name, _: os.open(name, flags, 0o666))


def lock_exclusively(file: IO[str]) -> None:
    """Lock `file` for this process or raise OSError at once; the system releases it when the process ends."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_held(error: OSError) -> bool:
    """Whether `lock_exclusively` raised `error` because somebody else holds the lock; else it never can be taken."""
    return error.errno in _HELD


def _write_through(folder: Path) -> None:
    """Wait until the disk has the contents of all files below `folder`."""
    for parent, _, names in os.walk(folder):
        for name in names:
            path = Path(parent, name)
            # Windows wants a file that is open for writing; elsewhere a read-only one may be waited for too.
            with open(path, "rb" if os.name == "posix" else "rb+") as file:
                os.fsync(file.fileno())
