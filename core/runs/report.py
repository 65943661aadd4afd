"""report.json and report.html of a finished run. Standard library only: the process that started the workers writes."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files.untrusted import is_file, is_there, read_json
from .layout import (
    CAMERAS_FILE,
    CAPTURE_FOLDER,
    GAUSSIANS_FILE,
    IMAGES_FOLDER,
    RENDERS_FOLDER,
    REPORT_FILE,
    REPORT_PAGE,
    SIMULATED_FOLDER,
    SIMULATED_INPUT_FOLDER,
    TURNTABLE_FOLDER,
    evenly_spread,
    layer_gaussians_file,
    picture_name,
)

SCHEMA = "cvdgs-report-1"
_VIEWS_SHOWN = 3
SCORED_PICTURES = {
    "input": "photographs",
    "enhanced": "enhanced photographs",
    "unenhanced": "scene, original colours",
    "rendered": "scene, enhanced colours",
}
"""What the metrics of a layer are computed on: key in the report, and what tables call it."""

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8882; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 1180px; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p.lead { margin-top: .2rem; opacity: .75; }
figure { margin: 0; } figcaption { font-size: .82rem; opacity: .8; margin-top: .2rem; }
.quad { display: grid; grid-template-columns: repeat(4, 1fr); gap: .6rem; margin-bottom: 1.2rem; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(300px, 1fr)); gap: .8rem; }
@media (max-width: 760px) { .quad { grid-template-columns: repeat(2, 1fr); } }
img { width: 100%; height: auto; display: block; border-radius: 3px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { text-align: right; padding: .25rem .7rem; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom-width: 2px; }
.bar { display: flex; height: 1.1rem; border-radius: 3px; overflow: hidden; background: var(--soft); }
.bar span { display: block; border-right: 1px solid #fff8; }
ul.notes { padding-left: 1.1rem; } code { background: var(--soft); padding: 0 .25em; border-radius: 3px; }
"""
# Distinguishable for all kinds of colour vision by lightness (Okabe-Ito, ordered from dark to light).
_STAGE_COLORS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")


_TURNTABLE_PICTURES = 4  # that the page shows


_TEXT, _NUMBER, _WHOLE = (str,), (int, float, type(None)), (int,)
_FIGURES = dict.fromkeys(SCORED_PICTURES, _NUMBER)
_LAYER_SHAPE = {
    "ccpr": {**_FIGURES, "tau": _NUMBER},
    "ccpr_mean": _FIGURES,
    "ssim_simulated": _FIGURES,
    "naturalness": {"ssim": _NUMBER, "delta_e": _NUMBER},
    "rwe": {"ratio": _NUMBER, "enhanced_ratio": _NUMBER},
    "psnr_to_enhanced": _NUMBER,
}
# What of a report is used again when layers are added to its run. A type in brackets is that of a list's entries, `...`
# stands for any key.
_SHAPE: Mapping[str, Any] = {
    "schema": _TEXT,
    "settings": {"capture": _TEXT, "layers": [{}]},
    "versions": {},
    "device": _TEXT,
    "capture": dict.fromkeys(("views", "train", "test", "width", "height"), _WHOLE),
    "gaussians": _WHOLE,
    "reconstruction": {"psnr": _NUMBER, "ssim": _NUMBER},
    "seconds": {...: _NUMBER, "total": _NUMBER},
    "peak_memory_mb": _NUMBER,
    "layers": {...: _LAYER_SHAPE},
    "views_shown": [_TEXT],
    "curve": [{...: _NUMBER, "seconds": (int, float)}],
    "notes": {...: _TEXT},
    "warnings": [{"name": _TEXT, "message": _TEXT}],
}


def check_report(report: Any) -> None:
    """Make sure that `report` is what `finish_report` wrote, as far as it is used again.

    Raises:
        ValueError: it is not; says where.
    """
    _check_shape(report, _SHAPE, "report")


def _check_shape(value: Any, shape: Any, path: str) -> None:
    if isinstance(shape, tuple):
        if type(value) not in shape:
            raise ValueError(f"{path} is unusable")
        return
    if not isinstance(value, list if isinstance(shape, list) else dict):
        raise ValueError(f"{path} is unusable")
    if isinstance(value, list):
        for index, entry in enumerate(value):
            _check_shape(entry, shape[0], f"{path}[{index}]")
        return
    for name in shape:
        if name is not ... and name not in value:
            raise ValueError(f"{path}.{name} is missing")
    for name, entry in value.items():
        if name in shape or ... in shape:
            _check_shape(entry, shape.get(name, shape.get(...)), f"{path}.{name}")


def finish_report(folder: Path, report: dict[str, Any]) -> None:
    """Write ``report.json`` and ``report.html`` into the run's folder, whose pictures the page embeds."""
    (folder / REPORT_FILE).write_text(json.dumps(report, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    (folder / REPORT_PAGE).write_text(_page(folder, report), encoding="utf-8")


def latest_seconds(report: dict[str, Any]) -> dict[str, float | None]:
    """The seconds of each stage of the run that wrote the report last: the first, or one that added layers."""
    return (report.get("resumed") or [report])[-1]["seconds"]


def without_non_finite(report: dict[str, Any]) -> dict[str, Any]:
    """JSON has neither NaN nor infinity: such numbers become null, and ``notes`` says why, by the number's path."""
    notes = dict(report["notes"])
    return {**_clean(report, "", notes), "notes": notes}


def _clean(value: Any, path: str, notes: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _clean(item, f"{path}.{key}" if path else str(key), notes) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(item, f"{path}[{i}]", notes) for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        notes[path] = "there is nothing to measure it on" if math.isnan(value) else "infinite: the images are the same"
        return None
    return value


def _page(folder: Path, report: dict[str, Any]) -> str:
    capture, reconstruction = report["capture"], report["reconstruction"]
    title = f"cvdgs: {Path(report['settings']['capture']).name or 'capture'}"
    judged = "held out" if capture["test"] else "on training views"
    lead = (
        f"{capture['views']} views ({capture['train']} for training, {capture['test']} held out) at "
        f"{capture['width']}×{capture['height']} · {report['gaussians']:,} Gaussians · "
        f"{_number(reconstruction['psnr'], 2)} dB {judged} · {_number(report['seconds']['total'], 0)} s"
    )
    parts = [f"<h1>{html.escape(title)}</h1><p class='lead'>{html.escape(lead)}</p>"]
    for name, layer in report["layers"].items():
        parts.append(f"<h2>{html.escape(name)}</h2>")
        parts += [_quad(folder, name, key) for key in report["views_shown"][:_VIEWS_SHOWN]]
        parts.append(_layer_table(layer))
    parts += [_stills(folder, report), _turntable(folder, report)]
    parts.append("<h2>Where the time went</h2>" + _timings(report["seconds"]))
    for added in report.get("resumed", ()):
        parts.append(f"<h3>Added later: {html.escape(', '.join(added['layers']))}</h3>" + _timings(added["seconds"]))
    parts.append("<h2>Training</h2>" + _curve(report["curve"]) + _decision(report))
    parts.append(_notes(report))
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def _quad(folder: Path, layer: str, key: str) -> str:
    """Photograph and result, as normal and as simulated vision see them."""
    cvd, renders = html.escape(layer.partition("-")[0]), folder / RENDERS_FOLDER / layer
    pictures = (
        (folder / CAPTURE_FOLDER / IMAGES_FOLDER, "photograph"),
        (renders, "enhanced, rendered"),
        (renders / SIMULATED_INPUT_FOLDER, f"photograph, as {cvd} vision sees it"),
        (renders / SIMULATED_FOLDER, f"enhanced, as {cvd} vision sees it"),
    )
    figures = "".join(_figure(place / f"{key}.png", caption) for place, caption in pictures)
    return f"<div class='quad'>{figures}</div>"


def _stills(folder: Path, report: dict[str, Any]) -> str:
    stills = [(folder / path, Path(path).stem) for path in (report.get("blender") or {}).get("stills", ())]
    if not stills:
        return ""
    figures = "".join(_figure(path, f"{name}, rendered by Blender's Cycles") for path, name in stills)
    return f"<h2>In Blender</h2><div class='pair'>{figures}</div>"


def _turntable(folder: Path, report: dict[str, Any]) -> str:
    """A few pictures of the newest layer's turn, evenly spread."""
    turntable = report.get("turntable")
    if not turntable:
        return ""
    layer, count = turntable["layers"][-1], turntable["frames"]
    numbers = evenly_spread(count, _TURNTABLE_PICTURES)
    sequence = folder / TURNTABLE_FOLDER / layer
    figures = (_figure(sequence / picture_name(i), f"{layer}, picture {i} of {count}") for i in numbers)
    return f"<h2>Turntable</h2><div class='quad'>{''.join(figures)}</div>"


def _figure(path: Path, caption: str) -> str:
    if not path.is_file():
        return ""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    text = html.escape(caption)
    return f"<figure><img alt='{text}' src='data:image/png;base64,{data}'><figcaption>{text}</figcaption></figure>"


def _layer_table(layer: dict[str, Any]) -> str:
    ccpr, similarity, natural, rwe = layer["ccpr"], layer["ssim_simulated"], layer["naturalness"], layer["rwe"]
    rows = (
        (f"contrast kept (CCPR, τ = {ccpr['tau']})", *(ccpr[kind] for kind in SCORED_PICTURES)),
        ("contrast kept, mean over τ", *(layer["ccpr_mean"][kind] for kind in SCORED_PICTURES)),
        ("SSIM, original to simulated", *(similarity[kind] for kind in SCORED_PICTURES)),
        ("naturalness: SSIM to the original", None, natural["ssim"], None, None),
        ("naturalness: mean ΔE00 to the original", None, natural["delta_e"], None, None),
        ("view consistency: RWE (1 = as the photographs)", None, rwe["enhanced_ratio"], None, rwe["ratio"]),
        ("rendered against enhanced, PSNR in dB", None, None, None, layer["psnr_to_enhanced"]),
    )
    body = "".join(
        f"<tr><td>{html.escape(name)}</td>" + "".join(f"<td>{_number(value, 3)}</td>" for value in values) + "</tr>"
        for name, *values in rows
    )
    head = "<tr><th></th>" + "".join(f"<th>{SCORED_PICTURES[kind]}</th>" for kind in SCORED_PICTURES) + "</tr>"
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _timings(seconds: dict[str, float | None]) -> str:
    stages = [(name, value) for name, value in seconds.items() if name != "total" and value]
    total = seconds.get("total") or sum(value for _, value in stages) or 1.0
    colors = dict(zip((name for name, _ in stages), _STAGE_COLORS, strict=False))
    bar = "".join(
        f"<span style='width:{100 * value / total:.2f}%;background:{colors.get(name, '#888')}' title='{name}'></span>"
        for name, value in stages
    )
    rows = "".join(
        f"<tr><td><span style='color:{colors.get(name, 'inherit')}'>■</span> {name}</td>"
        f"<td>{_number(value, 1)} s</td></tr>"
        for name, value in [*stages, ("total", total)]
    )
    return f"<div class='bar'>{bar}</div><table><tbody>{rows}</tbody></table>"


def _curve(curve: list[dict[str, float]]) -> str:
    """Held-out PSNR over seconds as an inline SVG."""
    points = [(item["seconds"], item["psnr"]) for item in curve if item.get("psnr") is not None]
    if len(points) < 2:
        return "<p>No held-out views, so no curve.</p>"
    width, height, margin = 560, 220, 44
    t_max = max(t for t, _ in points)
    low, high = math.floor(min(p for _, p in points)), math.ceil(max(p for _, p in points))
    high = max(high, low + 1)

    def place(t: float, p: float) -> tuple[float, float]:
        x = margin + (width - margin - 8) * t / t_max
        return x, 8 + (height - margin) * (1 - (p - low) / (high - low))

    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(t, p) for t, p in points))
    marks = "".join(f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3'/>" for x, y in (place(t, p) for t, p in points))
    labels = "".join(
        f"<text x='{margin - 8}' y='{place(0, p)[1] + 4:.1f}' text-anchor='end'>{p}</text>" for p in {low, high}
    )
    labels += f"<text x='{width - 8}' y='{height - 14}' text-anchor='end'>{t_max:.0f} s</text>"
    labels += f"<text x='{margin}' y='{height - 14}'>0 s · held-out PSNR in dB over training time</text>"
    return (
        f"<svg viewBox='0 0 {width} {height}' width='{width}' role='img' font-size='12' fill='currentColor'>"
        f"<polyline points='{line}' fill='none' stroke='currentColor' stroke-width='1.5'/>{marks}{labels}</svg>"
    )


def _decision(report: dict[str, Any]) -> str:
    """What training decided by itself and why, and what it had to leave out."""
    items = [
        f"<li>{html.escape(name.replace('_', ' '))}: {html.escape(str(text))}</li>"
        for name, text in report.get("decision", {}).items()
    ]
    if report.get("skipped_steps"):
        items.append(f"<li>{report['skipped_steps']} steps were left out because a number was not finite</li>")
    return f"<ul class='notes'>{''.join(items)}</ul>" if items else ""


def _notes(report: dict[str, Any]) -> str:
    items = [f"<li><code>{html.escape(name)}</code> {html.escape(text)}</li>" for name, text in report["notes"].items()]
    items += [
        f"<li><code>{html.escape(item['name'])}</code> {html.escape(item['message'])}</li>"
        for item in report["warnings"]
    ]
    facts = {**report["versions"], "device": report["device"], "peak memory": f"{report['peak_memory_mb']} MB"}
    text = " · ".join(f"{html.escape(str(k))} {html.escape(str(v))}" for k, v in facts.items())
    heading = "<h2>Notes</h2>" + (f"<ul class='notes'>{''.join(items)}</ul>" if items else "")
    return heading + f"<p class='lead'>{text}</p>"


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:,.{digits}f}"


CAMERAS = f"{CAPTURE_FOLDER}/{CAMERAS_FILE}"
_REMEDY = "give the output folder of a finished run of scripts/run.py"


def check_finished_run(folder: Path) -> list[str]:
    """The layers of the run in `folder`; one whose file was lost is none, for it can be added again.

    Raises:
        InputError: there is no run, it is damaged, of another version, or its geometry or cameras are missing.
    """
    layers = list(read_report(folder)["layers"])
    for name in (GAUSSIANS_FILE, CAMERAS):
        if not is_file(folder / name):
            raise InputError(f"the run has no {name}", where=folder, remedy=_REMEDY)
    return [layer for layer in layers if (folder / layer_gaussians_file(layer)).is_file()]


def report_or_nothing(folder: Path) -> dict[str, Any]:
    """What the report of the run in `folder` says, for who can do without; empty where it cannot be read."""
    try:
        report = read_json(folder / REPORT_FILE)
    except InputError:
        return {}
    return report if isinstance(report, dict) else {}


def read_report(folder: Path) -> dict[str, Any]:
    """The report of the run in `folder`.

    Raises:
        InputError: there is none, or it is damaged or of another version.
    """
    if not is_there(folder / REPORT_FILE):
        raise InputError("no finished run is there", where=folder, remedy=_REMEDY)
    report = read_json(folder / REPORT_FILE, remedy=_REMEDY)
    if not isinstance(report, dict) or "schema" not in report:
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    if report["schema"] != SCHEMA:
        raise InputError(f"a run of another version ({report['schema']})", where=folder, remedy="make the run again")
    if not isinstance(report.get("layers"), dict) or not isinstance(report.get("settings"), dict):
        raise InputError(f"{REPORT_FILE} of the finished run is damaged", where=folder, remedy=_REMEDY)
    return report
