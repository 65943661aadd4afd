"""Batch files: what they say, and everything that is wrong with them in one go, each with its line."""

import json
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cvdgs.core.batch.batch_file import read_batch
from cvdgs.core.batch.model import Output
from cvdgs.core.batch.toml_reader import LineNumbers, UnusableFile
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


def problems(batch, text: str) -> list[tuple[int, str]]:
    with pytest.raises(UnusableFile) as refusal:
        batch(text)
    return [(problem.line, problem.text) for problem in refusal.value.problems]


def test_a_capture_alone_is_a_batch(batch, tmp_path):
    (item,) = batch(ITEM).items
    assert (item.name, item.capture, item.run) == ("chair", tmp_path / "chair", None)
    assert item.layers == ("original", "deutan-1.0")
    assert item.outputs == set(Output)
    assert (item.turntable.frames, item.turntable.size, item.turntable.engines) == (96, (640, 480), ("cycles",))
    assert [camera.name for camera in item.cameras] == ["turn"]


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
    assert second.outputs == {Output.VIDEO}


def test_everything_wrong_is_said_in_one_go_with_its_line(batch):
    found = problems(
        batch,
        "layer = 3\n"  # 1
        "retries = -1\n"
        "[train]\n"
        "iterations = 0\n"  # 4
        'device = "gpu"\n'
        "sh-degree = 1\n"
        'holdout = "8"\n'  # 7
        "[turntable]\n"
        "frames = 0\n"
        "size = [641, 480]\n"  # 10
        'engines = ["cycle"]\n'
        "[cameras.low]\n"
        'height = "a"\n'  # 13
        "[[items]]\n"
        'capture = "nowhere"\n'
        "layers = [\n"  # 16
        '  "deutan",\n'
        '  "deuten",\n'
        '  "deutan-1.0",\n'  # 19
        "]\n"
        "[[items]]\n"
        'capture = "chair"\n'  # 22
        'run = "chair"\n'
        'name = "a/b"\n'
        "turntable = { frames = 5, chunk = -1 }\n",  # 25
    )
    assert [line for line, _ in found] == [1, 2, 4, 5, 6, 7, 9, 10, 11, 13, 15, 18, 19, 21, 23, 24, 25]
    texts = dict(found)
    assert texts[1].endswith("did you mean 'layers'?")
    assert "train.iterations: 0 is out of range" in texts[4]
    assert "did you mean 'sh_degree'?" in texts[6]
    assert "did you mean 'cycles'?" in texts[11]
    assert "nowhere" in texts[15]
    assert "'deuten' is not known" in texts[18]
    assert "twice" in texts[19]
    assert "items[2]: needs either a capture or a run" in texts[21]
    assert "items[2].turntable.chunk" in texts[25]


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("a = \n", 1, "no valid TOML"),
        ("title = 'x'\n\n[items\n", 3, "no valid TOML"),
        ("title = 'x'\n", 1, "no items"),
        ("items = []\n", 1, "no items"),
        ("items = 3\n", 1, "[[items]]"),
        (ITEM + ITEM, 3, "both called 'chair'"),
        (ITEM + 'name = "Chair"\n' + ITEM, 4, "both called"),
        ('layers = ["original"]\n' + ITEM, 3, "needs a layer"),
        (ITEM + 'cameras = ["side"]\n', 3, "'side' is not known"),
        (ITEM + 'train = { mode = "joint", refine_poses = true }\n', 3, "refine-poses"),
        (ITEM + 'train.enhancer = "missing.safetensors"\n', 3, "no such file"),
        (ITEM + 'layers = ["deutan-1.5"]\n', 3, "severity from 0 to 1"),
        (ITEM + 'layers = ["deutan-1..0"]\n', 3, "severity from 0 to 1"),
        (ITEM + "turntable.frames = true\n", 3, "whole number"),
        (ITEM + "outputs = []\n", 3, "list of texts"),
        ('[[items]]\nrun = "chair"\n', 2, "no finished run"),
        ('title = """\nA\nlong one\n"""\nretry = 1\n' + ITEM, 5, "did you mean 'retries'?"),
        ('"reti\\u0065s" = 1 # = [\n' + ITEM, 1, "is not known"),
    ],
)
def test_a_problem_is_found_at_its_line(batch, text, line, said):
    ((found, problem),) = problems(batch, text)
    assert found == line
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
    assert "splats.ply" in problems(batch, text)[0][1]
    report = json.loads((run / "report.json").read_text())
    (run / "report.json").write_text(json.dumps({**report, "schema": "cvdgs-report-99"}))
    assert "another version" in problems(batch, text)[0][1]
    (run / "report.json").write_text("[1]")
    assert "damaged" in problems(batch, text)[0][1]


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


# A document is written from a nested value with one value a line, and the lines are counted while it is written.
_KEYS = st.text("ab.\"'# =[", min_size=1, max_size=4)
_VALUES = st.one_of(
    st.integers(), st.booleans(), st.floats(allow_nan=False), st.text("ab\"'\\\n#=[]{},"), st.lists(st.integers())
)
_TABLES = st.dictionaries(_KEYS, _VALUES, max_size=4)


@given(st.lists(st.tuples(_KEYS, st.booleans(), _TABLES), max_size=6, unique_by=lambda entry: entry[0]))
def test_every_value_of_a_document_has_the_line_where_it_is_written(tables):
    lines, places = [], {}
    for name, is_array, table in tables:
        header = json.dumps(name)
        path = (name, 0) if is_array else (name,)
        lines.append(f"[[{header}]]" if is_array else f"[{header}]  # [not = this]")
        places[path] = len(lines)
        for key, value in table.items():
            lines.append(f"{json.dumps(key)} = {_written(value)}")
            places[(*path, key)] = len(lines)
            if isinstance(value, list):
                places.update({(*path, key, index): len(lines) for index in range(len(value))})
    text = "\n".join(lines)
    tomllib.loads(text)
    numbers = LineNumbers(text)
    assert {path: numbers[path] for path in places} == places


def _written(value) -> str:
    return json.dumps(value).replace("Infinity", "inf")


def test_strings_of_several_lines_do_not_confuse_the_count():
    text = (
        "a = '''\n[b]\n'''\n"
        'c = """x\\"""\n = 3""""\n'
        "d = [ # ]\n  1,\n  { e = 2 },\n]\n"
        "f.g = 1979-05-27 07:32:00\n"
    )
    tomllib.loads(text)
    numbers = LineNumbers(text)
    lines = [numbers[path] for path in [("a",), ("c",), ("d", 0), ("d", 1, "e"), ("f", "g"), ("h",)]]
    assert lines == [1, 4, 7, 8, 10, 1]


def test_the_batch_file_of_the_documentation_is_one(batch, tmp_path):
    from cvdgs.core.batch import batch_file

    text = batch_file.__doc__.partition("\n\n")[2]
    finished = 'run = "finished/sofa"'
    (tmp_path / "captures" / "chair").mkdir(parents=True)
    (found,) = problems(batch, text)
    assert found[0] == 1 + text[: text.index(finished)].count("\n")
    assert Path("finished/sofa").name in found[1]
