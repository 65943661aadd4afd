"""The page as a participant uses it: by mouse and keyboard, broken off and resumed, without a network."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cvdgs.core.errors import InputError
from cvdgs.scripts.benchmarks.browser import WITHOUT_GRAPHICS, browser, find_browser
from cvdgs.scripts.benchmarks.observers.answers import read_answers
from cvdgs.scripts.benchmarks.observers.page import PAGE_FILE, write_study_page
from cvdgs.scripts.benchmarks.observers.study import KEY_FILE, QUESTIONS, Key, with_codes, write_key

from .sessions import METHODS, ROWS, stimuli

PHOTOGRAPHS, TURNS = 1, 3
PAIRS = PHOTOGRAPHS * 6 + 1  # four methods of a photograph, two of the turntable
TRIALS = 2 * (PAIRS + round(PAIRS / 4))
NODE = shutil.which("node") or shutil.which("nodejs")
PARTICIPANT = Path(__file__).with_name("participant.js")
in_node = pytest.mark.skipif(NODE is None, reason="needs node")


def made(folder: Path) -> Key:
    key, coded = with_codes(stimuli(photographs=PHOTOGRAPHS, turns=TURNS), "command", 0)
    write_key(folder, key)
    write_study_page(folder, key, coded)
    return key


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def key(place) -> Key:
    return made(place)


def test_the_page_names_no_method_and_no_address(key: Key, place: Path) -> None:
    text = re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "", (place / PAGE_FILE).read_text(encoding="utf-8"))
    named = json.loads(text[text.index('id="study">') + len('id="study">') :].split("</script>")[0])["stimuli"]
    assert not [method for method in METHODS if method in json.dumps(named)]
    assert not re.search(r"https?:|//[a-z]+\.", text)
    assert "default-src 'none'" in text
    assert KEY_FILE not in text


try:
    find_browser()
    BROWSER = ""
except InputError as error:
    BROWSER = str(error)
in_browser = pytest.mark.skipif(bool(BROWSER), reason=BROWSER)


@pytest.fixture(scope="module")
def running() -> Iterator[Any]:
    with browser(WITHOUT_GRAPHICS) as started:
        yield started


@pytest.fixture
def page(running, place, key) -> Iterator[Any]:
    context = running.new_context(viewport={"width": 1280, "height": 800}, accept_downloads=True)
    page = context.new_page()
    page.errors, page.asked = [], []
    page.on("pageerror", lambda error: page.errors.append(error))
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto((place / PAGE_FILE).as_uri() + "#seed=77")
    yield page
    assert page.errors == []
    assert [url for url in page.asked if not url.startswith(("data:", "file:", "blob:"))] == []
    context.close()


def arrange(page: Any, row: list[int]) -> None:
    page.get_by_role("button", name="I agree. Begin").click()
    for cap in row:
        page.locator(f".pool [data-cap='{cap}']").click()
    page.get_by_role("button", name="The row is finished").click()


def answer(page: Any, number: int, keys: str = "ArrowLeft") -> None:
    page.wait_for_selector(f"main[data-stage='pairs'][data-ready='{number}']")
    page.keyboard.press(keys)


def answer_all(page: Any, first: int = 0) -> None:
    for number in range(first, TRIALS):
        start = page.get_by_role("button", name="Start")
        if page.locator("main[data-stage='begin']").count():
            start.click()
        answer(page, number, ("ArrowLeft", "ArrowRight")[number % 2])


def saved_file(page: Any, folder: Path) -> Path:
    with page.expect_download() as download:
        page.get_by_role("button", name="Save my answers").click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


@in_browser
def test_a_participant_goes_from_consent_to_a_file_that_the_analysis_reads(page, key, tmp_path) -> None:
    arrange(page, ROWS["protan"])
    answer_all(page)
    path = saved_file(page, tmp_path)
    (participant,) = read_answers([path], key)
    assert participant.cvd == "protan"
    assert json.loads(path.read_text())["cvd"] == "protan"
    assert len(participant.answers) == TRIALS
    asked = [found.question for found in participant.answers]
    assert sorted(set(asked)) == sorted(QUESTIONS)
    assert asked == sorted(asked, key=asked.index)  # one block after the other
    shown = [found for found in participant.answers if not found.repeat]
    assert len({(found.question, found.pair) for found in shown}) == len(shown) == 2 * PAIRS
    assert {key.shown[code].cvd for found in shown for code in found.pair} == {"protan"}
    assert {found.kind for found in shown} == {"still", "turntable"}
    assert json.loads(path.read_text())["participant"] == format(77, "x")


@in_browser
@pytest.mark.parametrize("cvd", ROWS)
def test_the_page_reads_the_row_as_the_analysis_does(page, cvd) -> None:
    assert page.evaluate("(row) => typeOf(row)", ROWS[cvd]) == cvd


@in_browser
def test_a_session_goes_on_where_it_was_broken_off(page, key, tmp_path) -> None:
    arrange(page, ROWS["deutan"])
    page.get_by_role("button", name="Start").click()
    for number in range(3):
        answer(page, number)
    page.wait_for_selector("main[data-ready='3']")
    before = page.evaluate("JSON.stringify(trials)")
    page.reload()
    assert page.evaluate("JSON.stringify(trials)") == before
    page.get_by_role("button", name="Go on where I stopped").click()
    page.wait_for_selector("main[data-stage='pairs'][data-ready='3']")
    page.get_by_role("button", name="Undo the last answer").click()
    answer_all(page, first=2)
    (participant,) = read_answers([saved_file(page, tmp_path)], key)
    assert len(participant.answers) == TRIALS


@in_browser
def test_the_keyboard_alone_is_enough_for_the_caps(page) -> None:
    page.keyboard.press("Enter")
    for _ in range(15):
        page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    assert page.locator("main[data-stage='begin']").count() == 1


@in_browser
def test_a_cap_goes_back_and_the_next_one_takes_its_place(page) -> None:
    page.get_by_role("button", name="I agree. Begin").click()
    for cap in (3, 9):
        page.locator(f".pool [data-cap='{cap}']").click()
    page.locator(".tray:not(.pool) [data-cap='3']").click()
    page.locator(".pool [data-cap='5']").click()
    assert page.evaluate("session.row.slice(0, 3)") == [5, 9, 0]


@in_browser
def test_participants_see_other_orders_and_both_sides(page) -> None:
    orders = [page.evaluate(f"trialsOf({seed}, 'deutan').map((t) => t.left.code + t.right.code)") for seed in (1, 2)]
    assert orders[0] != orders[1]
    assert page.evaluate("trialsOf(1, 'deutan').map((t) => t.left.code + t.right.code)") == orders[0]
    trials = page.evaluate("trialsOf(3, 'deutan').map((t) => [t.repeat, t.question.id, t.left.code, t.right.code])")
    first = {tuple(trial[1:]): place for place, trial in enumerate(trials) if not trial[0]}
    repeats = [place - first[q, right, left] for place, (again, q, left, right) in enumerate(trials) if again]
    assert len(repeats) == TRIALS - 2 * PAIRS
    assert min(repeats) > 0


@in_browser
@pytest.mark.parametrize("size", [(1280, 800), (768, 1024), (1024, 768)])
def test_everything_of_a_pair_is_on_the_screen(page, size) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    arrange(page, ROWS["deutan"])
    page.get_by_role("button", name="Start").click()
    page.wait_for_selector("main[data-ready='0']")
    for part in page.locator("h1, img, footer button, footer span").all():
        box = part.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
        assert box["y"] + box["height"] <= size[1]


def shown_after(place: Path, folder: Path, *steps: str) -> list[dict[str, Any]]:
    """What the page shows after each of the steps of somebody who agreed and put the caps in a row."""
    before = ("I agree. Begin", "arrange", "The row is finished")
    (folder / "row.json").write_text(json.dumps(ROWS["deutan"]))
    (folder / "steps.json").write_text(json.dumps([*before, *steps]))
    arguments = [place / PAGE_FILE, folder / "row.json", folder / "steps.json"]
    done = subprocess.run([NODE, PARTICIPANT, *arguments], capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)[len(before) :]


GO_ON, ANEW = "Go on where I stopped", "I am somebody else. Begin anew"
ARRANGED = ("I agree. Begin", "arrange", "The row is finished", "Start")
A_PAIR = ("tick", "ArrowLeft")


@in_node
def test_a_session_that_is_broken_off_between_the_questions_goes_on(place, key, tmp_path) -> None:
    first_block = ["Start", *A_PAIR * (TRIALS // 2)]
    shown = shown_after(place, tmp_path, "reload", GO_ON, *first_block, "reload", GO_ON, "Start")
    before, between, again, second = shown[1], shown[-4], shown[-2], shown[-1]
    assert before["stage"] == between["stage"] == again["stage"] == "begin"
    assert again["headline"] == between["headline"] != before["headline"]
    assert second == {**again, "stage": "pairs"}


@in_node
def test_the_next_participant_at_a_computer_begins_anew_and_the_one_befores_answers_are_kept(
    place, key, tmp_path
) -> None:
    *_, asked, begun = shown_after(place, tmp_path, "Start", *A_PAIR * 3, "reload", ANEW)
    assert (asked["stage"], asked["files"]) == ("back", [])
    assert begun["stage"] == "welcome"
    (kept,) = begun["files"]
    (tmp_path / "answers.json").write_text(json.dumps(kept))
    (participant,) = read_answers([tmp_path / "answers.json"], key)
    assert (participant.name, len(participant.answers)) == (format(77, "x"), 3)
    second = shown_after(place, tmp_path, "Start", *A_PAIR, "reload", ANEW, *ARRANGED, *A_PAIR, "reload", ANEW)
    assert [file["participant"] for file in second[-1]["files"]] == [format(77, "x"), "feedbeef"]


@in_node
@pytest.mark.parametrize("seed", ["4294967301", "-1", "1.5", "nonsense"])
def test_any_seed_in_the_address_gives_a_participant_that_the_analysis_reads(place, key, tmp_path, seed) -> None:
    steps = (f"#seed={seed}", ANEW, *ARRANGED, *A_PAIR, "reload", ANEW)
    (tmp_path / "answers.json").write_text(json.dumps(shown_after(place, tmp_path, *steps)[-1]["files"][0]))
    read_answers([tmp_path / "answers.json"], key)


@in_node
def test_an_answer_that_is_undone_at_once_leaves_no_turntable_turning(tmp_path) -> None:
    turning = [replace(one, versions=tuple(replace(v, frames=v.frames * 3) for v in one.versions)) for one in stimuli()]
    key, coded = with_codes(turning, "command", 0)
    write_study_page(tmp_path, key, coded)
    second_thoughts = (*A_PAIR, "Undo the last answer", *A_PAIR)
    pair, last = shown_after(tmp_path, tmp_path, "Start", *second_thoughts, "tick")[-2:]
    assert (pair["turning"], last["turning"]) == (0, 1)
