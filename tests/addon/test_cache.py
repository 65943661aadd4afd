"""The cache keeps to its size and touches nothing but what it made; and folders as fields have them."""

from __future__ import annotations

import os

from hypothesis import given
from hypothesis import strategies as st

from cvdgs.cvdgs_addon.folders import Cache, normalised_folder


@given(st.lists(st.integers(0, 400), max_size=12), st.integers(0, 2000))
def test_what_was_used_longest_ago_goes_first(tmp_path_factory, sizes, limit):
    cache = Cache(tmp_path_factory.mktemp("cache"))
    folder = cache.thumbnails("photos")
    folder.mkdir(parents=True)
    for age, size in enumerate(sizes):
        path = folder / f"{age}.png"
        path.write_bytes(b"x" * size)
        os.utime(path, (1_000_000 - age, 1_000_000 - age))
    assert cache.size() == sum(sizes)
    cache.shrink(limit)
    assert cache.size() <= limit
    kept = sorted(int(path.stem) for path in folder.iterdir())
    # Everything that is younger than what went is still there.
    assert kept == list(range(len(kept)))
    assert len(kept) == len(sizes) or sum(sizes[: len(kept) + 1]) > limit or sizes[len(kept)] == 0


def test_clearing_leaves_other_files_alone(tmp_path):
    cache = Cache(tmp_path)
    cache.kernels.mkdir()
    (cache.kernels / "kernel.o").write_bytes(b"x")
    (tmp_path / "mine.txt").write_text("not the cache's")
    cache.clear()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    assert cache.size() == 0


def test_captures_do_not_share_their_thumbnails(tmp_path):
    cache = Cache(tmp_path)
    assert cache.thumbnails("one") != cache.thumbnails("two")
    assert cache.thumbnails("one") == cache.thumbnails("one")


def test_folders_are_named_in_full(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert normalised_folder("results/") == str(tmp_path / "results")
    assert normalised_folder("") == ""
