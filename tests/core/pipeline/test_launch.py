"""A run on the console, with worker processes that behave and misbehave in known ways."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from cvdgs.core.errors import InputError
from cvdgs.core.pipeline import launch
from cvdgs.core.pipeline.continuation import describe_run
from cvdgs.core.runtime.process import Workers
from cvdgs.core.settings import Layer, Settings

from ...patience import SOON
from ..workers import REPORT, ROOT, start_run


@pytest.fixture
def run(tmp_path):
    """Starts run.py with a worker whose body is given; returns the started process."""

    def start(
        body: str, *options: str, out: Path = tmp_path / "out", capture: str | Path = "photos", wait: bool = True
    ):
        process = start_run(tmp_path / "worker", body, *options, out=out, capture=capture)
        if wait:
            process.out, process.err = process.communicate(timeout=SOON)
        return process

    return start


def test_a_run_that_succeeds_puts_report_page_and_log_in_place(run, tmp_path):
    result = run(
        "emit('status', stage='capture', message='reading'); print('a library talks'); emit('result', report=REPORT)"
    )
    assert result.returncode == 0, result.err
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["report.html", "report.json", "run.log"]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["reconstruction"] == {"psnr": None, "ssim": 0.5}
    assert report["seconds"]["total"] > 0
    assert "a library talks" in (tmp_path / "out" / "run.log").read_text()


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"], ids=["stderr", "all"])
def test_a_run_that_a_service_starts_without_a_console_succeeds(run, tmp_path, monkeypatch, closed):
    told = run("emit('result', report=REPORT)", out=tmp_path / "told")
    monkeypatch.setenv("CVDGS_PYTHON", str(tmp_path / "worker"))
    command = [str(tmp_path / "untold") if word == str(tmp_path / "told") else word for word in told.args]
    assert subprocess.run(["sh", "-c", f'exec "$@" {closed}', "sh", *command], timeout=SOON).returncode == 0
    names = [{path.name for path in (tmp_path / folder).iterdir()} for folder in ("told", "untold")]
    assert names[0] == names[1]


def test_events_can_be_read_by_a_program(run):
    result = run(
        "emit('progress', stage='geometry', fraction=0.5, seconds_left=3.0); emit('result', report=REPORT)", "--json"
    )
    events = [json.loads(line) for line in result.out.splitlines()]
    assert [event["event"] for event in events] == ["status", "progress", "result"]


def test_unusable_input_is_one_line_and_exit_code_2(run, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text(json.dumps(REPORT))
    result = run("emit('error', kind='input', message='photos: no cameras - pass --sfm'); sys.exit(2)")
    assert result.returncode == 2
    assert result.err.splitlines()[-1] == "run.py: photos: no cameras - pass --sfm"
    assert "Traceback" not in result.err
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["report.json"]
    assert (tmp_path / "out" / "report.json").read_text() == json.dumps(REPORT)


@pytest.mark.parametrize(
    "body",
    ["raise ValueError('oops')", "os.kill(os.getpid(), signal.SIGSEGV)", "sys.exit(0)"],
    ids=["exception", "crash", "no-result"],
)
def test_a_defect_of_ours_is_one_line_exit_code_1_and_leaves_the_log(run, tmp_path, body):
    result = run("open(folder + '/half.ply', 'w').write('x')\n" + body)
    assert result.returncode == 1
    assert "Traceback" not in result.err
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["failed.run.log"]


@pytest.fixture
def earlier(tmp_path):
    """A finished run's files."""
    out = tmp_path / "out"
    (out / "capture").mkdir(parents=True)
    for name in ("splats.ply", "splats.deutan-1.0.ply", "capture/points.ply", "run.log", "scene.blend"):
        (out / name).write_text(f"earlier {name}\n")
    (out / "report.json").write_text(json.dumps(REPORT))
    return out


def test_a_resumed_run_adds_to_the_files_and_to_the_log(run, earlier):
    body = """
        assert open(folder + '/splats.ply').read() == 'earlier splats.ply\\n'
        open(folder + '/splats.protan-1.0.ply', 'w').write('new')
        seconds = {'layers': 2.0, 'blender': None, 'total': None}
        added = [{'layers': ['protan-1.0'], 'seconds': seconds}]
        emit('result', report={**REPORT, 'blender': {'stills': []}, 'resumed': added})
    """
    result = run(body, "--resume")
    assert result.returncode == 0, result.err
    names = {str(path.relative_to(earlier)) for path in earlier.rglob("*") if path.is_file()}
    assert names == {
        "splats.ply", "splats.deutan-1.0.ply", "splats.protan-1.0.ply", "capture/points.ply", "scene.blend",
        "run.log", "report.json", "report.html",
    }  # fmt: skip
    log = (earlier / "run.log").read_text()
    assert log.startswith("earlier run.log")
    assert '"resume": true' in log
    report = json.loads((earlier / "report.json").read_text())
    assert report["seconds"]["total"] is None  # the first run's own
    assert report["resumed"][0]["seconds"]["total"] > 0
    assert "lacks the new layers" in result.err


@pytest.mark.parametrize(
    ("options", "made", "note"),
    [
        ((), [450, 320, "protan"], ""),
        (("--quality", "draft"), [450, 320, "protan"], ""),
        (("--iterations", f"{Settings.iterations}"), [Settings.iterations, None, "deutan"], "another --iterations"),
        (("--max-size", "auto"), [Settings.iterations, None, "deutan"], "another --max-size"),
        (("--cvd", "deutan"), [Settings.iterations, None, "deutan"], "another --cvd"),
        (("--severity", "0.5"), [Settings.iterations, None, "deutan"], "another --cvd"),
    ],
)
def test_a_draft_that_was_broken_off_goes_on_unless_something_else_is_given(run, tmp_path, options, made, note):
    checkpoint = tmp_path / "out" / ".checkpoint"
    checkpoint.mkdir(parents=True)
    draft = Settings("photos", "out", (Layer("protan", 1.0),), iterations=450, max_size=320, blend=False)
    (checkpoint / "run.json").write_text(json.dumps(describe_run(draft)))
    (checkpoint / "state.safetensors").touch()
    body = "emit('result', report={**REPORT, 'settings': request['settings'], 'notes': request['checkpoint']})"
    result = run(body, "--resume", *options)
    assert result.returncode == 0, result.err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    settings = report["settings"]
    assert [settings["iterations"], settings["max_size"], settings["layers"][0]["cvd"]] == made
    assert report["notes"]["resume"] is (note == "")
    assert note in result.err


@pytest.mark.parametrize("json_events", [(), ("--json",)])
def test_the_usual_value_is_refused_where_it_is_given_and_the_finished_run_has_another(run, earlier, json_events):
    draft = Settings("photos", str(earlier), iterations=450, blend=False)
    (earlier / "report.json").write_text(json.dumps({**REPORT, "settings": draft.to_dict()}))
    result = run("emit('result', report=REPORT)", "--resume", "--iterations", f"{Settings.iterations}", *json_events)
    assert result.returncode == 2
    assert "--iterations: the finished run has 450, not 5000" in (result.out if json_events else result.err)
    assert "Traceback" not in result.err


def test_a_layer_that_is_added_leaves_the_checkpoint_of_another_training_in_the_folder(run, earlier):
    checkpoint = earlier / ".checkpoint"
    checkpoint.mkdir()
    fine = Settings("photos", str(earlier), iterations=7000, blend=False)
    (checkpoint / "run.json").write_text(json.dumps(describe_run(fine)))
    (checkpoint / "state.safetensors").write_bytes(b"an hour's work")
    result = run("emit('result', report=REPORT)", "--resume", "--cvd", "protan")
    assert result.returncode == 0, result.err
    assert (checkpoint / "state.safetensors").read_bytes() == b"an hour's work"
    result = run("emit('result', report=REPORT)")
    assert result.returncode == 0, result.err
    assert not checkpoint.exists(), "a training that succeeds replaces it"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ("emit('error', kind='input', message='no'); sys.exit(2)", 2),
        ("raise ValueError('oops')", 1),
        ("os.kill(os.getpid(), signal.SIGKILL)", 1),
    ],
    ids=["refused", "defect", "killed"],
)
def test_a_resumed_run_that_fails_loses_nothing(run, earlier, body, code):
    before = {path: path.read_bytes() for path in earlier.rglob("*") if path.is_file()}
    spoil = "open(folder + '/splats.ply', 'w').write('half')\nos.remove(folder + '/report.json')\n"
    assert run(spoil + body, "--resume").returncode == code
    after = {path: path.read_bytes() for path in earlier.rglob("*") if path.is_file()}
    after.pop(earlier / "failed.run.log", None)
    assert after == before


@pytest.mark.parametrize("folder", ["enhanced/deutan-1.0", "renders"])
def test_pictures_of_a_run_are_no_capture_for_one_in_its_place(earlier, monkeypatch, folder):
    (earlier / folder).mkdir(parents=True)
    monkeypatch.setattr(Workers, "start", lambda *_: pytest.fail("the work began"))
    with pytest.raises(InputError, match="among what the new run would replace - choose another folder with --out"):
        launch.run(Settings(str(earlier / folder), str(earlier), blend=False), lambda _: None, Workers(sys.executable))
    assert (earlier / "scene.blend").exists()


def test_a_run_may_be_made_anew_from_its_own_capture(run, earlier):
    result = run("emit('result', report=REPORT)", capture=earlier / "capture")
    assert result.returncode == 0, result.err
    assert not (earlier / "scene.blend").exists()


BLENDER = f"""#!{sys.executable}
import json, sys
sys.path[:0] = [{str(ROOT / "core")!r}]
import bootstrap
bootstrap.load()
from cvdgs.cvdgs_addon.scene.worker import _parse
options = _parse(sys.argv[sys.argv.index("--") + 1 :])
print(json.dumps({{"event": "result", "stills": [], "view": options.view}}))
"""


def test_blender_shows_a_view_whose_name_begins_with_a_dash(run, tmp_path, monkeypatch):
    """As do the names of many downloaded videos, after which their frames are called."""
    blender = tmp_path / "blender"
    blender.write_text(BLENDER)
    blender.chmod(0o755)
    monkeypatch.setenv("CVDGS_BLENDER", str(blender))
    result = run("emit('result', report={**REPORT, 'views_shown': ['-wtIMTCHWuI_0001']})", "--blend")
    assert result.returncode == 0, result.err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["blender"]["view"] == "-wtIMTCHWuI_0001"


@pytest.mark.parametrize("stubborn", [False, True], ids=["cooperative", "deaf"])
def test_ctrl_c_ends_the_run_soon_and_leaves_nothing(run, tmp_path, stubborn):
    ignore = "signal.signal(signal.SIGINT, signal.SIG_IGN)\n" if stubborn else ""
    body = (
        ignore
        + "open(folder + '/half.ply', 'w').write('x')\nemit('status', stage='geometry', message='')\ntime.sleep(60)"
    )
    process = run(body, "--json", wait=False)
    assert "starting" in process.stdout.readline()
    assert "geometry" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=SOON) == 130
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "mentions"),
    [
        (["--severity", "2"], "--severity"),
        (["--cvd", "deutan", "--cvd", "protan", "--severity", "1", "--severity", "1", "--severity", "1"], "--severity"),
        (["--iterations", "many"], "--iterations"),
        (["--mode", "both"], "--mode"),
        (["--quality", "superb"], "--quality"),
        (["--colour", "red"], "--colour"),
    ],
)
def test_unusable_options_are_one_line_and_exit_code_2(run, tmp_path, options, mentions):
    result = run("emit('result', report=REPORT)", *options)
    assert result.returncode == 2
    assert len(result.err.splitlines()) == 1
    assert mentions in result.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "iterations", "max_size"),
    [
        ((), Settings.iterations, None),
        (("--quality", "draft"), 450, 320),
        (("--quality", "fine"), 7000, 960),
        (("--iterations", "20", "--quality", "draft"), 20, 320),
        (("--quality", "standard", "--max-size", "auto"), 3000, None),
    ],
)
def test_a_quality_stands_for_steps_and_size_unless_these_are_given(run, tmp_path, options, iterations, max_size):
    asked = "{key: request['settings'][key] for key in ('iterations', 'max_size')}"
    result = run(f"emit('result', report={{**REPORT, 'settings': {asked} | {{'capture': 'photos'}}}})", *options)
    assert result.returncode == 0, result.err
    settings = json.loads((tmp_path / "out" / "report.json").read_text())["settings"]
    assert (settings["iterations"], settings["max_size"]) == (iterations, max_size)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that even root cannot write to")
def test_an_unwritable_output_folder_is_one_line_and_exit_code_2(run):
    result = run("emit('result', report=REPORT)", out=Path("/proc/out"))
    assert result.returncode == 2
    assert "--out" in result.err


@pytest.mark.parametrize("python", ["/no/python", "/tmp"])
def test_a_missing_interpreter_is_explained(tmp_path, python):
    """A virtual environment's folder is none."""
    command = [sys.executable, str(ROOT / "scripts" / "run.py"), "photos", "--out", str(tmp_path / "out")]
    result = subprocess.run(command, env={**os.environ, "CVDGS_PYTHON": python}, capture_output=True, text=True)
    assert result.returncode == 2
    assert "CVDGS_PYTHON" in result.stderr


def test_a_folder_whose_name_is_too_long_is_one_line_with_resume_too(run, tmp_path):
    result = run("emit('result', report=REPORT)", "--resume", out=tmp_path / ("long" * 100))
    assert result.returncode == 2
    assert "File name too long" in result.err
    assert "Traceback" not in result.err
