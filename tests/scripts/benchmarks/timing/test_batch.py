"""The figures of batches, on real frames of a small scene from one machine, from Dask and from the openjd command."""

import json

import pytest

pytest.importorskip("bpy", reason="there is no Blender to render with")
pytest.importorskip("distributed", reason="Dask is not installed (pip install cvdgs[farm])")
pytest.importorskip("openjd", reason="openjd is not installed (pip install cvdgs[farm])")
from cvdgs.core.runs.report import SCHEMA
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.scripts.benchmarks.timing.batch import BatchBenchmark, write_batch_figures

from ....addon.scenes import synthetic_run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def benchmark(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benchmark")
    run = synthetic_run(folder / "run")
    report = {"schema": SCHEMA, "layers": {"deutan-1.0": {}}, "settings": {"simulation": "machado"}}
    (run / "report.json").write_text(json.dumps(report))
    return BatchBenchmark(run, folder, frames=8, size=(48, 36), rounds=1)


def values(figures):
    return {figure.name: figure.value for figure in figures}


def test_every_engine_makes_frames_of_the_same_bits(benchmark):
    differing = values(benchmark.disagreement_of_engines(Reporter()))
    assert differing == {"of 8 frames, different from Dask": 0, "of 8 frames, different from openjd": 0}


def test_a_kill_costs_no_more_than_what_was_in_flight(benchmark):
    found = values(benchmark.work_lost_by_a_kill())
    assert found["tasks repeated after it"] <= found["tasks in flight at a kill"]


def test_a_thousand_items_are_checked_in_two_seconds(benchmark):
    assert values(benchmark.large_batch())["checking 1,000 items"] <= 2.0


def test_another_capture_is_inspected_in_half_a_second(benchmark):
    assert 0.0 < values(benchmark.inspecting_captures())["inspecting one more capture of 40 photographs"] < 500.0


def test_the_figures_are_written_as_a_table(benchmark, tmp_path):
    figures = benchmark.later_frames()
    text = write_batch_figures(tmp_path, figures)
    assert all(figure.name in text for figure in figures)
    assert len((tmp_path / "batch.csv").read_text().splitlines()) == 1 + len(figures)
