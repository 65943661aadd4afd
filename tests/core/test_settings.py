"""Settings: what is unusable is refused in one line, and they survive the way to the worker."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cvdgs.core.errors import InputError
from cvdgs.core.settings import CVD_TYPES, Layer, Settings


def settings(**changes) -> Settings:
    return Settings(capture="photos", out="result", **changes)


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"layers": (Layer("deutan", 2.0),)}, "--severity"),
        ({"layers": (Layer("deutan", float("nan")),)}, "--severity"),
        ({"layers": (Layer("purple", 1.0),)}, "--cvd"),
        ({"layers": (Layer("deutan", 1.0), Layer("deutan", 1.0))}, "--cvd"),
        ({"layers": ()}, "--cvd"),
        ({"simulation": "guess"}, "--simulation"),
        ({"strength": -0.1}, "--strength"),
        ({"iterations": 0}, "--iterations"),
        ({"iterations": 10**400}, "--iterations"),
        ({"gaussians": 0}, "--gaussians"),
        ({"sh_degree": 4}, "--sh-degree"),
        ({"mode": "both"}, "--mode"),
        ({"mode": "joint", "sh_degree": 1}, "--sh-degree"),
        ({"max_size": 8}, "--max-size"),
        ({"holdout": 1}, "--holdout"),
        ({"holdout": -3}, "--holdout"),
        ({"device": "tpu"}, "--device"),
        ({"seed": -1}, "--seed"),
        ({"turntable": 1}, "--turntable"),
        ({"turntable": 12, "blend": False}, "--turntable"),
        ({"engine": "workbench"}, "--engine"),
    ],
)
def test_unusable_values_name_their_option_in_one_line(changes, option):
    with pytest.raises(InputError) as caught:
        settings(**changes)
    assert option in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("mode", ["layers", "joint", "post"])
def test_every_mode_can_be_asked_for_and_be_added_to(mode):
    assert settings(mode=mode, resume=True).mode == mode


@pytest.mark.parametrize("enhancer", ["scene", "cgan", "lut", "none", "trained/enhancer.safetensors"])
def test_enhancers_are_names_or_files_of_weights(enhancer):
    assert settings(enhancer=enhancer).enhancer == enhancer


def test_an_unknown_enhancer_is_refused():
    with pytest.raises(InputError, match=r"--enhancer.*magic.*cgan"):
        settings(enhancer="magic")


@pytest.mark.parametrize(
    ("severity", "name"), [(1.0, "deutan-1.0"), (0.6, "deutan-0.6"), (0.65, "deutan-0.65"), (0.0, "deutan-0.0")]
)
def test_a_layer_is_named_after_type_and_severity(severity, name):
    assert Layer("deutan", severity).name == name


@given(severity=st.floats(0.0, 1.0), cvd=st.sampled_from(CVD_TYPES))
@example(severity=1e-5, cvd="tritan")
def test_a_layer_is_known_by_its_name(severity, cvd):
    name = Layer(cvd, severity).name
    assert Layer.from_name(name).name == name
    assert Layer.from_name(name).cvd == cvd
    assert Layer.is_name(name)


@pytest.mark.parametrize("text", ["", "subject", "deutan", "deutan-mine", "deutan-2.0", "deutan-nan", "deutan-1"])
def test_what_no_layer_is_called_is_no_name_of_one(text):
    assert not Layer.is_name(text)


@pytest.mark.parametrize(
    ("mode", "asked", "corrects"),
    [("layers", None, True), ("post", None, True), ("joint", None, False), ("layers", False, False)],
)
def test_cameras_are_corrected_where_the_mode_can_unless_it_is_switched_off(mode, asked, corrects):
    assert settings(mode=mode, refine_poses=asked).corrects_poses == corrects


@pytest.mark.parametrize(
    ("mode", "asked", "checks"), [("layers", None, True), ("joint", None, True), ("post", False, False)]
)
def test_the_lens_is_looked_at_in_every_mode_unless_cameras_are_to_be_taken_as_they_are(mode, asked, checks):
    assert settings(mode=mode, refine_poses=asked).checks_lens == checks


def test_settings_survive_the_way_to_the_worker():
    original = settings(layers=(Layer("protan", 0.5), Layer("tritan", 1.0)), max_size=320, gaussians=900)
    assert Settings.from_dict(original.to_dict()) == original


def test_unknown_settings_are_refused():
    with pytest.raises(InputError, match="flavour"):
        Settings.from_dict({**settings().to_dict(), "flavour": "mint"})


def test_two_points_and_the_metres_between_them_give_the_length_of_a_unit() -> None:
    assert Settings("c", "o", scale="0,0,0 0,-1.5,2 5").metres_per_unit == pytest.approx(2.0)
    assert Settings("c", "o").metres_per_unit is None
    for unusable in (
        "2.4",
        "0,0,0 0,0,0 1",
        "0,0 1,1 1",
        "0,0,0 1,1,1 -2",
        "0,0,0 1,1,nan 2",
        "a b c",
        "0,0,0 1,1,1 1e99",
    ):
        with pytest.raises(InputError, match="is no reference"):
            Settings("c", "o", scale=unusable)


def test_a_printed_tag_of_known_side_takes_the_place_of_two_points() -> None:
    settings = Settings("c", "o", scale="tag:0.15")
    assert settings.tag_side == 0.15
    assert settings.metres_per_unit is None
    assert Settings("c", "o", scale="0,0,0 1,0,0 2").tag_side is None
    for unusable in ("tag:", "tag:a", "tag:0", "tag:-1", "tag:nan", "tag:1e9"):
        with pytest.raises(InputError, match="is no side of a tag"):
            Settings("c", "o", scale=unusable)
