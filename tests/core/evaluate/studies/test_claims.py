"""What has to hold: claims that figures bear out, and such that they do not."""

import math

from cvdgs.core.evaluate.studies.claims import claims_of, write_claims
from cvdgs.core.evaluate.studies.recipe import Recipe, Trial, described


def trial(**figures) -> Trial:
    return Trial(**described("room", Recipe("any")), **figures)


def claims(*, layers=0.8, post=1.5, auto=2000, fixed=3000, change=0.0):
    return claims_of(trial(rwe=layers, gaussians=auto), trial(rwe=post), trial(gaussians=fixed), trial(delta_e=change))


def test_good_figures_bear_all_claims_out():
    assert all(claim.holds for claim in claims())


def test_each_claim_can_fail():
    for worse in ({"layers": 1.5}, {"auto": 3001}, {"change": 0.01}):
        assert sum(not claim.holds for claim in claims(**worse)) == 1


def test_what_could_not_be_measured_does_not_hold():
    assert sum(not claim.holds for claim in claims(layers=math.nan)) == 1


def test_the_page_marks_what_does_not_hold(tmp_path):
    text = write_claims(tmp_path, claims(auto=4000), ["By `the command`."])
    (broken,) = (line for line in text.splitlines() if "**no**" in line)
    assert "auto takes no more Gaussians" in broken
    assert (tmp_path / "claims.csv").is_file()
