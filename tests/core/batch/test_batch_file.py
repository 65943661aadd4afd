"""Batch files: what they say, and everything that is wrong with them in one go, each problem with its place."""

import json
from pathlib import Path

import pytest

from cvdgs.core.batch.batch_file import read_batch
from cvdgs.core.batch.model import Output
from cvdgs.core.batch.toml_reader import UnusableFile
from cvdgs.core.errors import InputError

from ...effort import function_calls

ITEM = '[[items]]\ncapture = "chair"\n'


@pytest.fixture
def batch(tmp_path):
    """Reads a batch of this text, in a folder that has the capture "chair"."""
    (tmp_path / "chair").mkdir(exist_ok=True)

    def read(text: str):
        path = tmp_path / "batch.toml"
        path.write_text(text)
        return read_batch(path)

    return read


def problems(batch, text: str) -> list[str]:
    with pytest.raises(UnusableFile) as refusal:
        batch(text)
    return list(refusal.value.problems)


def test_a_capture_alone_is_a_batch(batch, tmp_path):
    (item,) = batch(ITEM).items
    assert (item.name, item.capture, item.run) == ("chair", tmp_path / "chair", None)
    assert item.layers == ("original", "deutan-1.0")
    assert item.outputs == set(Output)
    assert (item.turntable.frames, item.turntable.size, item.turntable.engines) == (96, (640, 480), ("cycles",))
    assert [camera.name for camera in item.cameras] == ["turn"]
    assert item.cameras[0].height is None, "as high as the photographs were taken from"


@pytest.mark.parametrize(("file", "name"), [("walk.mp4", "walk-mp4"), ("chair.zip", "chair-zip")])
def test_a_video_or_a_zip_is_a_capture(batch, tmp_path, file, name):
    (tmp_path / file).touch()
    (item,) = batch(f'[[items]]\ncapture = "{file}"\n').items
    assert (item.name, item.capture, item.source) == (name, tmp_path / file, tmp_path / file)


def test_an_items_own_values_come_before_the_batchs(batch):
    first, second = batch(
        'layers = ["deutan"]\noutputs = ["frames"]\n[train]\niterations = 9\nseed = 3\n[turntable]\nframes = 12\n'
        "chunk = 5\n[cameras.low]\nheight = 0\n[cameras.high]\nheight = 1\n"
        + ITEM
        + ITEM
        + 'name = "other"\nlayers = ["tritan-0.5"]\ncameras = ["high"]\noutputs = ["video"]\n'
        + "train.iterations = 8\nturntable.frames = 24\n"
    ).items
    assert (first.layers, second.layers) == (("deutan-1.0",), ("tritan-0.5",))
    assert (first.train, second.train) == ({"iterations": 9, "seed": 3}, {"iterations": 8, "seed": 3})
    assert (first.turntable.frames, second.turntable.frames) == (12, 24)
    assert second.turntable.chunk == 5
    assert [[camera.name for camera in item.cameras] for item in (first, second)] == [["low", "high"], ["high"]]
    assert [camera.height for camera in first.cameras] == [0.0, 1.0]
    assert second.outputs == {Output.VIDEO}


def test_files_are_looked_for_beside_the_batch_file(batch, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for name in ("weights.safetensors", "cameras.json"):
        (tmp_path / name).touch()
    given = '[train]\nenhancer = "weights.safetensors"\ncameras = "chair/../cameras.json"\n'
    own = ITEM + 'name = "other"\ntrain.cameras = "estimate"\n'
    first, second = batch(given + ITEM + own).items
    assert first.train == {
        "enhancer": str(tmp_path / "weights.safetensors"),
        "cameras": str(tmp_path / "cameras.json"),
    }
    assert second.train["cameras"] == "estimate"


def test_everything_wrong_is_said_in_one_go_with_its_place(batch):
    found = problems(
        batch,
        "layer = 3\n"
        "retries = -1\n"
        "[train]\n"
        "iterations = 0\n"
        'device = "gpu"\n'
        "sh-degree = 1\n"
        'holdout = "8"\n'
        "[turntable]\n"
        "frames = 0\n"
        "size = [641, 480]\n"
        'engines = ["cycle"]\n'
        "[cameras.low]\n"
        'height = "a"\n'
        "[[items]]\n"
        'capture = "nowhere"\n'
        "layers = [\n"
        '  "deutan",\n'
        '  "deuten",\n'
        '  "deutan-1.0",\n'
        "]\n"
        "[[items]]\n"
        'capture = "chair"\n'
        'run = "chair"\n'
        'name = "a/b"\n'
        "turntable = { frames = 5, chunk = -1 }\n",
    )
    texts = dict(problem.split(": ", 1) for problem in found)
    assert set(texts) == {
        *("layer", "retries", "train.iterations", "train.device", "train.sh-degree", "train.holdout"),
        *("turntable.frames", "turntable.size", "turntable.engines[1]", "cameras.low.height"),
        *("items[1].capture", "items[1].layers[2]", "items[1].layers[3]"),
        *("items[2]", "items[2].run", "items[2].name", "items[2].turntable.chunk"),
    }
    assert len(found) == len(texts)
    assert texts["layer"].endswith("did you mean 'layers'?")
    assert "0 is out of range" in texts["train.iterations"]
    assert "did you mean 'sh_degree'?" in texts["train.sh-degree"]
    assert "did you mean 'cycles'?" in texts["turntable.engines[1]"]
    assert "nowhere" in texts["items[1].capture"]
    assert "unknown layer 'deuten'" in texts["items[1].layers[2]"]
    assert "twice" in texts["items[1].layers[3]"]
    assert "either a capture or a run" in texts["items[2]"]


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("a = \n", "line 1", "not valid TOML"),
        ("title = 'x'\n\n[items\n", "line 3", "not valid TOML"),
        ('[[items]]\ncapture = "C:\\Users\\me"\n', "line 2", "in 'single quotes'"),
        ('[[items]]\ncapture = "D:\\"\n', "line 2", "in 'single quotes'"),
        ('[[items]]\ncapture = "C:\\temp"\n', "items[1].capture", "in 'single quotes'"),
        ('[[items]]\nrun = "C:\\new\\run"\n', "items[1].run", "in 'single quotes'"),
        (ITEM + 'train.enhancer = "C:\\new.safetensors"\n', "items[1].train.enhancer", "in 'single quotes'"),
        ("a = " + "9" * 5000 + "\n", "not valid TOML", "digits"),
        ("a" + ".a" * 40 + " = 1\n", "line 1", "dots"),
        ("title = 'x'\n", "the batch has no items", "add [[items]]"),
        ("items = []\n", "the batch has no items", "add [[items]]"),
        ("items = 3\n", "items", "[[items]]"),
        (ITEM + ITEM, "items[2].name", "both called 'chair'"),
        (ITEM + 'name = "Chair"\n' + ITEM, "items[2].name", "both called"),
        (ITEM + 'name = "aux"\n', "items[1].name", "is a device on Windows, no folder"),
        ('layers = ["original"]\n' + ITEM, "items[1].capture", "needs a layer"),
        (ITEM + 'cameras = ["side"]\n', "items[1].cameras[1]", "'side'"),
        (ITEM + 'train = { mode = "joint", refine_poses = true }\n', "items[1].train", "refine-poses"),
        (ITEM + 'train.enhancer = "missing.safetensors"\n', "items[1].train.enhancer", "no such file"),
        (ITEM + 'train.cameras = "nowhere/transforms.json"\n', "items[1].train.cameras", "no such file"),
        (ITEM + 'train.cameras = ""\n', "items[1].train.cameras", "nothing is given"),
        (ITEM + 'layers = ["deutan-1.5"]\n', "items[1].layers[1]", "severity from 0 to 1"),
        (ITEM + 'layers = ["deutan-1..0"]\n', "items[1].layers[1]", "severity from 0 to 1"),
        ('[[items]]\ncapture = "walk.mp4"\n', "items[1].capture", "no such file or folder"),
        (ITEM + "train.iterations = 1" + "0" * 400 + "\n", "items[1].train.iterations", "too many digits"),
        (ITEM + "train.strength = 1" + "0" * 400 + "\n", "items[1].train.strength", "unusable"),
        ("[cameras.low]\n[cameras.Low]\n" + ITEM, "cameras.Low", "differs from 'low' in capitals alone"),
        ("cameras.low.height = 1" + "0" * 400 + "\n" + ITEM, "cameras.low.height", "give a number"),
        ("cameras.low.height = 0x" + "f" * 5000 + "\n" + ITEM, "cameras.low.height", "thousands of digits"),
        (ITEM + "turntable.frames = true\n", "items[1].turntable.frames", "whole number"),
        (ITEM + "outputs = []\n", "items[1].outputs", "list of texts"),
        ('[[items]]\nrun = "chair"\n', "items[1].run", "no finished run"),
        ('title = """\nA\nlong one\n"""\nretry = 1\n' + ITEM, "retry", "did you mean 'retries'?"),
        ('"reti\\u0065s" = 1 # = [\n' + ITEM, "reties", "unknown key"),
    ],
)
def test_a_problem_names_its_place(batch, text, place, said):
    (problem,) = problems(batch, text)
    assert problem.startswith(place)
    assert said in problem


def test_a_layer_whose_file_was_lost_is_one_that_the_run_lacks(batch, collection):
    run = collection.add_finished_run("finished", "deutan-1.0", "protan-1.0")
    (run / "splats.deutan-1.0.ply").unlink()
    assert batch(f"[[items]]\nrun = '{run}'\n").items[0].present == ("protan-1.0",)


def test_a_run_of_another_version_or_without_geometry_is_refused(batch, collection):
    run = collection.add_finished_run("finished", "deutan-1.0")
    text = f"[[items]]\nrun = '{run}'\n"
    assert batch(text).items[0].present == ("deutan-1.0",)
    (run / "splats.ply").unlink()
    assert "splats.ply" in problems(batch, text)[0]
    report = json.loads((run / "report.json").read_text())
    (run / "report.json").write_text(json.dumps({**report, "schema": "cvdgs-report-99"}))
    assert "another version" in problems(batch, text)[0]
    (run / "report.json").write_text("[1]")
    assert "damaged" in problems(batch, text)[0]


def test_what_is_no_text_is_refused(tmp_path):
    (tmp_path / "batch.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        read_batch(tmp_path / "batch.toml")
    with pytest.raises(InputError, match="cannot be read"):
        read_batch(tmp_path)


def test_an_item_among_a_thousand_is_read_with_no_more_effort_than_among_ten(batch):
    def read_items(count: int) -> None:
        text = "".join(
            f'[[items]]\nname = "item-{n}"\ncapture = "chair"\nlayers = ["original", "deutan", "protan-0.6"]\n'
            f"turntable.frames = 48\ntrain.iterations = {n + 1}\n"
            for n in range(1000, 1000 + count)
        )
        assert len(batch(text).items) == count

    assert function_calls(lambda: read_items(1000)) < 105 * function_calls(lambda: read_items(10))


def test_the_batch_file_of_the_documentation_is_one(batch, tmp_path):
    from cvdgs.core.batch import batch_file

    text = batch_file.__doc__.partition("\n\n")[2]
    (tmp_path / "captures" / "chair").mkdir(parents=True)
    (found,) = problems(batch, text)
    assert found.startswith("items[2].run: ")
    assert Path("finished/sofa").name in found
