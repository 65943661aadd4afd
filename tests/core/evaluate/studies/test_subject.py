"""Captures as recipes are given and judged by them."""

import pytest

from cvdgs.core.demo import SHOWROOM
from cvdgs.core.evaluate.studies.subject import CaptureFolder


def test_recipes_can_be_given_smaller_photographs_than_they_are_judged_by():
    subject = CaptureFolder("demo", SHOWROOM, 64, fitted_size=48).load()
    assert {view.camera.width for view in subject.given.views} == {48}
    assert {view.camera.width for view in subject.judged.views} == {64}
    assert [view.key for view in subject.given.views] == [view.key for view in subject.judged.views]
    assert subject.split == subject.judged_split
    assert not subject.is_ordinary


@pytest.mark.parametrize("fitted_size", [None, 64, 100])
def test_photographs_are_not_enlarged(fitted_size):
    assert CaptureFolder("demo", SHOWROOM, 64, fitted_size).load().is_ordinary


def test_a_subject_s_key_tells_sizes_apart():
    keys = {CaptureFolder("demo", SHOWROOM, 64, size).key for size in (None, 32, 48)}
    assert len(keys) == 3
