"""The examples of docs/extending.md, run as they stand on the page."""

from __future__ import annotations

import csv
import re
import sys
import tomllib

import numpy as np
import pytest

from cvdgs.core.bootstrap import ROOT
from cvdgs.core.capture.images import read_pixels
from cvdgs.core.capture.reader import read_capture
from cvdgs.core.color.metrics import ccpr
from cvdgs.core.color.simulation import simulate
from cvdgs.core.color.spaces import image_to_tensor
from cvdgs.core.enhance import make_enhancer
from cvdgs.core.errors import InputError
from cvdgs.core.files.images import to_bytes, write_png
from cvdgs.core.photographs.front import EnhanceRequest
from cvdgs.core.photographs.job import enhance_folder
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import Layer, Settings
from cvdgs.core.splats.io.ply import read_ply

PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
LONGEST_EXAMPLE = 40  # lines; the page promises about thirty


def blocks(title: str) -> list[str]:
    """The code blocks of a section, in order."""
    (section,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
    return re.findall(r"^```\w+\n(.*?)^```", section, re.MULTILINE | re.DOTALL)


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package of the page's first example, as pip would install it."""
    module, project = blocks("An enhancer")
    entry = tomllib.loads(project)["project"]
    (tmp_path / "deutan_shift.py").write_text(module, encoding="utf-8")
    folder = tmp_path / f"deutan_shift-{entry['version']}.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {entry['name']}\nVersion: {entry['version']}\n")
    groups = entry["entry-points"].items()
    lines = [line for group, points in groups for line in (f"[{group}]", *(f"{k} = {v}" for k, v in points.items()))]
    (folder / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def test_an_installed_enhancer_is_used_by_its_name(installed):
    name = "plugin:blue_shift"
    assert Settings("capture", "out", layers=(Layer("deutan", 1.0),), enhancer=name).enhancer == name
    stripes = np.zeros((32, 32, 3), np.uint8)
    stripes[:, ::2], stripes[:, 1::2] = (150, 90, 90), (105, 110, 90)
    enhancer = make_enhancer(name, "deutan", 1.0)
    enhancer.fit([stripes])
    original = image_to_tensor(stripes)
    seen = [simulate(image_to_tensor(image), "deutan", 1.0) for image in (stripes, to_bytes(enhancer(stripes)))]
    before, after = (ccpr(original, image)[0] for image in seen)
    assert after > before + 0.5
    assert np.array_equal(to_bytes(make_enhancer(name, "deutan", 0.0)(stripes)), stripes)


def test_an_enhancer_that_is_not_installed_is_one_line():
    with pytest.raises(InputError, match="'plugin:blue_shift' is not installed"):
        make_enhancer("plugin:blue_shift", "deutan", 1.0)


def test_an_enhancer_that_cannot_be_loaded_is_one_line(installed):
    (installed / "entry_points.txt").write_text("[cvdgs.enhancers]\nblue_shift = gone_module:BlueShift\n")
    with pytest.raises(InputError, match="cannot be loaded") as refusal:
        make_enhancer("plugin:blue_shift", "deutan", 1.0)
    assert "gone_module" in str(refusal.value)


@pytest.mark.parametrize("module", ["1 / 0", "def BlueShift(**who):\n    return 1 / 0"])
def test_an_enhancer_that_fails_when_it_is_loaded_or_made_is_one_line(installed, module):
    (installed.parent / "faulty_shift.py").write_text(module)
    (installed / "entry_points.txt").write_text("[cvdgs.enhancers]\nblue_shift = faulty_shift:BlueShift\n")
    sys.modules.pop("faulty_shift", None)
    with pytest.raises(InputError, match=r"cannot be loaded .*division by zero"):
        make_enhancer("plugin:blue_shift", "deutan", 1.0)


def installed_as(installed, monkeypatch, call: str, fit: str = "pass"):
    """The enhancer of the package, were its module this one."""
    (installed.parent / "other_shift.py").write_text(
        "import numpy as np\n"
        "class BlueShift:\n"
        "    def __init__(self, **who): pass\n"
        f"    def fit(self, images, reporter=None, *, alphas=None): {fit}\n"
        f"    def __call__(self, image): {call}\n"
    )
    (installed / "entry_points.txt").write_text("[cvdgs.enhancers]\nblue_shift = other_shift:BlueShift\n")
    monkeypatch.delitem(sys.modules, "other_shift", raising=False)
    return make_enhancer("plugin:blue_shift", "deutan", 1.0)


GREY = np.full((8, 8, 3), 100, np.uint8)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("1 / 0", r"fails \(ZeroDivisionError"),
        ("return image[:2] / 255.0", r"shape \(2, 8, 3\)"),
        ("return image", "type uint8"),
        ("return image.astype(float)", "not from 0 to 1"),
    ],
)
def test_an_enhancer_that_gives_no_image_is_one_line_with_its_name(installed, monkeypatch, call, said):
    enhancer = installed_as(installed, monkeypatch, call)
    with pytest.raises(InputError, match=f"plugin:blue_shift.*{said}"):
        enhancer(GREY)


def test_an_enhancer_that_cannot_be_fitted_is_one_line_with_its_name(installed, monkeypatch):
    enhancer = installed_as(installed, monkeypatch, "return image / 255.0", fit="raise KeyError('x')")
    with pytest.raises(InputError, match=r"plugin:blue_shift.*cannot be fitted \(KeyError"):
        enhancer.fit([GREY])


def test_an_enhancer_cannot_change_the_photographs(installed, monkeypatch):
    image, alpha = GREY.copy(), np.full((8, 8), 200, np.uint8)
    enhancer = installed_as(
        installed, monkeypatch, "image[:] = 0; return image / 255.0", fit="images[0][:] = alphas[0][:] = 0"
    )
    enhancer.fit([image], alphas=[alpha])
    assert not enhancer(image).any()
    assert (image == 100).all()
    assert (alpha == 200).all()


def test_pixels_that_an_enhancer_gives_no_finite_colour_are_counted_in_photographs_too(
    installed, monkeypatch, tmp_path
):
    installed_as(installed, monkeypatch, "image = image / 255.0; image[0] = np.nan; return image * 0.5")
    write_png(tmp_path / "a.png", np.dstack([GREY[..., 0], GREY[..., 0] // 2, GREY[..., 0]]))
    warned = {}

    class Recorder(Reporter):
        def warning(self, name, message):
            warned[name] = message

    (tmp_path / "out").mkdir()
    request = EnhanceRequest((str(tmp_path / "a.png"),), str(tmp_path / "out"), enhancer="plugin:blue_shift")
    enhance_folder(request, tmp_path / "out", Recorder())
    assert "plugin:blue_shift: the enhancer gave no finite colour for 8 pixels" in warned["enhancer-not-finite"]
    enhanced = read_pixels(tmp_path / "out" / "a.png", min_side=1)[0]
    assert enhanced[:2, 0, 0].tolist() == [100, 50]


@pytest.mark.parametrize("name", ["os:system", "plugin:os.system", "plugin:", "plugin:../x"])
def test_a_name_cannot_choose_a_module(name):
    with pytest.raises(InputError):
        Settings("capture", "out", layers=(Layer("deutan", 1.0),), enhancer=name)


def test_the_strategy_trains_the_demo(tmp_path, monkeypatch, capsys):
    strategy, training = blocks("A densification strategy")
    monkeypatch.chdir(tmp_path)
    namespace = {"__name__": __name__}  # a dataclass looks for its module
    exec(strategy, namespace)
    exec(training.replace('"core/demo', f'"{ROOT}/core/demo'), namespace)
    before, after, decibels = re.search(r"(\d+) -> (\d+) Gaussians, ([\d.]+) dB", capsys.readouterr().out).groups()
    assert int(before) < int(after) <= 10_000
    assert float(decibels) > 20.0
    assert len(read_ply(tmp_path / "divided.ply")) == int(after)


def test_the_importer_makes_a_capture_with_the_cameras_of_the_table(tmp_path):
    rows = [
        {"file": f"{i}.png", "width": 64, "height": 48, "focal": 60, "at_x": 3.0, "at_y": i, "at_z": 1.0}
        | {"to_x": 0.0, "to_y": 0.0, "to_z": 0.5}
        for i in range(3)
    ]
    rng = np.random.default_rng(0)
    for row in rows:
        write_png(tmp_path / row["file"], rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    with open(tmp_path / "cameras.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    namespace: dict = {}
    exec(blocks("An importer")[0], namespace)
    namespace["import_table"](tmp_path / "cameras.csv", tmp_path / "capture")
    capture = read_capture(tmp_path / "capture", max_size=None)
    assert len(capture.views) == 3
    for view, row in zip(capture.views, rows, strict=True):
        assert view.center == pytest.approx([row["at_x"], row["at_y"], row["at_z"]])
        x, y, z = view.world_to_camera[:3, :3] @ (np.array([0.0, 0.0, 0.5]) - view.center)
        assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-9)
        assert z > 0.0
        assert (view.world_to_camera[:3, :3] @ [0.0, 0.0, 1.0])[1] < 0.0  # up in the world is up in the picture


def test_the_examples_are_short():
    assert all(len(block.splitlines()) <= LONGEST_EXAMPLE for block in re.findall(r"```\w+\n(.*?)```", PAGE, re.DOTALL))
