"""When a task counts as done: from the same inputs, with the same arguments, and with all that it left in place."""

import json
import os
import shutil
from dataclasses import replace

import pytest

from cvdgs.core.batch import records as done
from cvdgs.core.batch.records import is_done, record_path, sign_inputs, write_record
from cvdgs.core.batch.task import Kind, Task
from cvdgs.core.errors import InputError
from cvdgs.core.runs.layout import pictures
from cvdgs.core.runs.measured import note_metres

FRAMES = Task(
    "chair.frames",
    Kind.FRAMES,
    arguments={"first": 1, "last": 3},
    inputs=("chair/run/splats.ply", "chair/run/capture"),
    outputs=(pictures("chair/frames", 1, 3),),
    cores=2,
    seconds=10.0,
)


@pytest.fixture
def out(tmp_path):
    """A batch's folder in which `FRAMES` is done."""
    run, frames = tmp_path / "chair" / "run", tmp_path / "chair" / "frames"
    (run / "capture").mkdir(parents=True)
    (run / "splats.ply").write_text("Gaussians")
    (run / "capture" / "cameras").write_text("cameras")
    inputs = sign_inputs(FRAMES, tmp_path)
    frames.mkdir()
    for number in range(1, 4):
        (frames / f"{number:04d}.png").write_text(f"picture {number}")
    write_record(FRAMES, tmp_path, inputs, 12.0)
    return tmp_path


def test_what_was_recorded_is_done(out):
    assert is_done(FRAMES, out)


def test_what_was_never_done_is_not(out):
    assert not is_done(replace(FRAMES, name="sofa.frames"), out)


def test_other_arguments_make_another_task(out):
    assert not is_done(replace(FRAMES, arguments={"first": 1, "last": 4}), out)


def test_what_a_task_takes_of_a_machine_does_not(out):
    assert is_done(replace(FRAMES, cores=8, memory_mb=5, gpu=1, seconds=1.0), out)


def test_the_layers_that_are_made_along_with_a_run_do_not_make_it_another(out):
    train = Task("chair.train", Kind.TRAIN, arguments={"settings": {"seed": 0}, "layers": [{"cvd": "deutan"}]})
    write_record(train, out, sign_inputs(train, out), 1.0)
    assert is_done(replace(train, arguments={**train.arguments, "layers": [{"cvd": "protan"}]}), out)
    assert not is_done(replace(train, arguments={**train.arguments, "settings": {"seed": 1}}), out)


def test_another_version_does_everything_again(out, monkeypatch):
    monkeypatch.setattr(done, "__version__", "99")
    assert not is_done(FRAMES, out)


@pytest.mark.parametrize("content", [None, "", "picture 2 and more"])
def test_an_output_that_is_missing_or_of_another_size_is_made_again(out, content):
    path = out / "chair/frames/0002.png"
    path.unlink() if content is None else path.write_text(content)
    assert not is_done(FRAMES, out)


def test_an_input_that_has_changed_makes_it_be_done_again(out):
    (out / "chair/run/splats.ply").write_text("gAUSSIANS")
    assert not is_done(FRAMES, out)


@pytest.mark.parametrize("change", ["remove", "add", "link"])
def test_so_do_files_that_come_and_go_in_a_folder(out, change):
    cameras = out / "chair/run/capture/cameras"
    if change == "add":
        cameras.with_name("more").touch()
    else:
        cameras.unlink()
        if change == "link":
            cameras.symlink_to("elsewhere")
    assert not is_done(FRAMES, out)


LEFT_BY_PROGRAMS = [".DS_Store", "images/._1.jpg", "images/Thumbs.db", "Desktop.ini", ".thumbnails/1.jpg"]


@pytest.fixture
def training(tmp_path):
    """A training from a capture in `tmp_path` that was done."""
    images, out = tmp_path / "capture" / "images", tmp_path / "out"
    images.mkdir(parents=True)
    out.mkdir()
    for number in (1, 2):
        (images / f"{number}.jpg").write_text(f"photograph {number}")
    task = Task("chair.train", Kind.TRAIN, inputs=(str(tmp_path / "capture"),))
    write_record(task, out, sign_inputs(task, out), 1.0)
    return task


def add(tmp_path, name, content="new"):
    path = tmp_path / "capture" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)


@pytest.mark.parametrize("name", LEFT_BY_PROGRAMS)
def test_what_programs_leave_in_a_capture_changes_nothing(tmp_path, training, name):
    add(tmp_path, name)
    assert is_done(training, tmp_path / "out")


def test_photographs_that_were_enhanced_beside_it_change_nothing(tmp_path, training):
    for content in ("enhanced", "enhanced again"):
        add(tmp_path, "for deutan/1.png", content)
        add(tmp_path, "for deutan/metrics.csv", "file,output\n1.jpg,1.png\n")
        assert is_done(training, tmp_path / "out")


READ = ["images/3.jpg", "masks/1.jpg.png", "images_again/1.jpg", "sparse/0/images.bin", "walk.mp4", "transforms.json"]


@pytest.mark.parametrize("name", READ)
def test_what_a_run_reads_of_a_capture_makes_it_be_done_again(tmp_path, training, name):
    out = tmp_path / "out"
    add(tmp_path, name)
    assert not is_done(training, out)
    write_record(training, out, sign_inputs(training, out), 1.0)
    assert is_done(training, out)
    add(tmp_path, name, "other")
    assert not is_done(training, out)


@pytest.mark.parametrize("folder", ["images", "dense/0/images", "for deutan", ".hidden"])
def test_so_do_hidden_and_enhanced_photographs_that_a_run_reads(tmp_path, training, folder):
    out = tmp_path / "out"
    if folder == "images":
        (tmp_path / "capture/images/1.jpg").unlink()
        (tmp_path / "capture/images/2.jpg").unlink()
    add(tmp_path, f"{folder}/1.png", "enhanced")
    add(tmp_path, f"{folder}/metrics.csv", "file,output\n1.jpg,1.png\n")
    add(tmp_path, "dense/0/sparse/images.bin")
    if folder in ("for deutan", ".hidden"):
        add(tmp_path, "transforms.json", json.dumps({"frames": [{"file_path": f"./{folder}/1.png"}]}))
    write_record(training, out, sign_inputs(training, out), 1.0)
    assert is_done(training, out)
    add(tmp_path, f"{folder}/1.png", "enhanced again")
    assert not is_done(training, out)


def test_so_do_enhanced_photographs_where_there_are_no_others(tmp_path, training):
    out = tmp_path / "out"
    shutil.rmtree(tmp_path / "capture/images")
    add(tmp_path, "sparse/0/images.bin")
    add(tmp_path, "for deutan/1.png")
    add(tmp_path, "for deutan/metrics.csv", "file,output\n1.jpg,1.png\n")
    write_record(training, out, sign_inputs(training, out), 1.0)
    add(tmp_path, "for deutan/1.png", "enhanced again")
    assert not is_done(training, out)


def test_a_record_that_counts_a_hidden_file_still_vouches(tmp_path, training):
    """As those that were made before hidden files were left out."""
    out = tmp_path / "out"
    add(tmp_path, ".DS_Store")
    path = record_path(training, out)
    record = json.loads(path.read_text())
    hidden = tmp_path / "capture/.DS_Store"
    record["inputs"][str(hidden)] = [3, hidden.stat().st_mtime_ns, "0"]
    path.write_text(json.dumps(record))
    assert is_done(training, out)
    record["inputs"]["a\0b"] = [3, 4, "0"]
    path.write_text(json.dumps(record))
    assert not is_done(training, out)


@pytest.mark.parametrize("model", ["sparse", "sparse/0", "colmap/sparse"])
def test_a_model_behind_a_link_counts(tmp_path, training, model):
    elsewhere, link, out = tmp_path / "elsewhere", tmp_path / "capture" / model, tmp_path / "out"
    elsewhere.mkdir()
    (elsewhere / "images.bin").write_text("cameras")
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(elsewhere)
    write_record(training, out, sign_inputs(training, out), 1.0)
    assert is_done(training, out)
    (elsewhere / "images.bin").write_text("other cameras")
    assert not is_done(training, out)


def test_a_run_that_somebody_measures_stays_done(tmp_path):
    task = Task("chair.train", Kind.TRAIN, outputs=("run/splats.ply", "run/capture/transforms.json"))
    cameras = tmp_path / "run/capture/transforms.json"
    cameras.parent.mkdir(parents=True)
    cameras.write_text("{}")
    (tmp_path / "run/splats.ply").write_text("Gaussians")
    (tmp_path / "run/report.json").write_text('{"capture": {}}')
    write_record(task, tmp_path, {}, 1.0)
    assert note_metres(tmp_path / "run", 0.25)
    assert is_done(task, tmp_path)
    cameras.unlink()
    assert not is_done(task, tmp_path)


@pytest.fixture
def linked(tmp_path, training):
    """The file at the end of a link that `training` reads."""
    original = tmp_path / "capture/.annex/object"
    original.parent.mkdir()
    original.write_text("photograph 3")
    (tmp_path / "capture/images/3.jpg").symlink_to("../.annex/object")
    write_record(training, tmp_path / "out", sign_inputs(training, tmp_path / "out"), 1.0)
    return original


@pytest.mark.parametrize("change", ["content", "remove", "dangle", "replace"])
def test_what_a_link_leads_to_counts(tmp_path, training, linked, change):
    link = tmp_path / "capture/images/3.jpg"
    assert is_done(training, tmp_path / "out")
    if change == "content":
        linked.write_text("photograph 4")
    elif change == "remove":
        link.unlink()
    else:
        linked.unlink()
        if change == "replace":
            linked.mkdir()
    assert not is_done(training, tmp_path / "out")


@pytest.mark.parametrize("change", ["touch", "move"])
def test_the_same_content_at_the_end_of_a_link_does_not(tmp_path, training, linked, change):
    if change == "touch":
        os.utime(linked, ns=(1, 1))
    else:
        linked.rename(linked.with_name("moved"))
        (tmp_path / "capture/images/3.jpg").unlink()
        (tmp_path / "capture/images/3.jpg").symlink_to("../.annex/moved")
    assert is_done(training, tmp_path / "out")


def test_a_link_that_leads_nowhere_counts_by_its_text(tmp_path, training):
    link, out = tmp_path / "capture/images/3.jpg", tmp_path / "out"
    link.symlink_to("3.jpg")  # to itself
    write_record(training, out, sign_inputs(training, out), 1.0)
    assert is_done(training, out)
    link.unlink()
    assert not is_done(training, out)
    link.symlink_to("nowhere")
    assert not is_done(training, out)


def test_a_record_with_the_text_of_a_link_alone_does_not_vouch_for_its_file(tmp_path, training, linked):
    """As those that were made before links were followed."""
    path = record_path(training, tmp_path / "out")
    record = json.loads(path.read_text())
    record["inputs"][str(tmp_path / "capture/images/3.jpg")] = ["../.annex/object"]
    path.write_text(json.dumps(record))
    assert not is_done(training, tmp_path / "out")


def test_a_file_inside_a_folder_that_is_an_input_too_counts_once(out):
    both = replace(FRAMES, inputs=(*FRAMES.inputs, "chair/run/capture/cameras", "chair/run"))
    write_record(both, out, sign_inputs(both, out), 1.0)
    assert is_done(both, out)
    (out / "chair/run/capture/cameras").write_text("others")
    assert not is_done(both, out)


def test_the_same_content_written_anew_does_not(out):
    path = out / "chair/run/splats.ply"
    path.write_text("Gaussians")
    os.utime(path, ns=(1, 1))
    assert is_done(FRAMES, out)


def test_the_folder_may_be_mounted_elsewhere(out):
    elsewhere = out.with_name("elsewhere")
    out.rename(elsewhere)
    assert is_done(FRAMES, elsewhere)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"fingerprint": 1}'])
def test_a_damaged_record_vouches_for_nothing(out, text):
    done.record_path(FRAMES, out).write_text(text)
    assert not is_done(FRAMES, out)


@pytest.mark.parametrize("name", ["a\0b", "a" * 300], ids=["zero-byte", "too-long"])
def test_a_record_of_an_output_that_no_file_can_be_vouches_for_nothing(out, name):
    path = record_path(FRAMES, out)
    path.write_text(json.dumps({**json.loads(path.read_text()), "outputs": {name: 1}}))
    assert not is_done(FRAMES, out)


def test_nothing_is_vouched_for_that_is_not_there(out):
    (out / "chair/frames/0001.png").unlink()
    with pytest.raises(FileNotFoundError):
        write_record(FRAMES, out, sign_inputs(FRAMES, out), 1.0)


def test_a_missing_input_is_said_except_for_the_page(out):
    missing = replace(FRAMES, inputs=("chair/run/nothing.ply",))
    with pytest.raises(InputError, match=r"nothing\.ply"):
        sign_inputs(missing, out)
    assert sign_inputs(replace(missing, kind=Kind.PAGE), out) == {"chair/run/nothing.ply": ()}


def test_the_page_is_made_again_when_what_was_missing_appears(out):
    page = Task("page", Kind.PAGE, inputs=("chair/run/report.json",))
    write_record(page, out, sign_inputs(page, out), 1.0)
    assert is_done(page, out)
    (out / "chair/run/report.json").touch()
    assert not is_done(page, out)
