"""Trains the conditional GAN: makes the pairs, trains on them, writes the weights. Run it again to continue.

python scripts/train_enhancer.py out/enhancer                        as much as two cores manage in an hour
python scripts/train_enhancer.py out/enhancer --preset full --device cuda
python scripts/train_enhancer.py out/enhancer --sweep all            the short trainings behind the settings
python scripts/run.py CAPTURE --out DIR --enhancer out/enhancer/training/enhancer.safetensors
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch is loaded: see the Makefile
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("torch", "OpenImageIO"))
import torch

from cvdgs.core.enhance.gan.weights import load_generator, read_notes
from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import ConsoleReporter, OneLineParser, exit_code
from cvdgs.core.runtime.devices import choose_device
from cvdgs.core.runtime.protocol import Reporter
from cvdgs.core.settings import DEVICES
from cvdgs.scripts.training.data.dataset import DatasetSettings, PairedDataset, make_dataset
from cvdgs.scripts.training.gan.batches import Examples
from cvdgs.scripts.training.gan.training import Training, TrainingSettings
from cvdgs.scripts.training.model_card import publish
from cvdgs.scripts.training.presets import PRESETS
from cvdgs.scripts.training.sweep import CHANGES, changed, sweep

VALIDATION_SHARE = 24  # one sample in so many is kept out of training, for validation
SWEEP_STEPS = 1500


def main(arguments: list[str]) -> int:
    """Train, sweep or publish; returns the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        if options.publish:
            print(f"wrote {publish(options.out / 'training', options.publish)}")
        else:
            train(options, ConsoleReporter(sys.stderr))

    return exit_code("train_enhancer.py", work, stopped="stopped; run again to continue")


def build_parser() -> argparse.ArgumentParser:
    """The options."""
    parser = OneLineParser(
        prog="train_enhancer.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("out", type=Path, metavar="DIR", help="receives pairs/, training/ and sweep/; what exists is reused")
    add("--preset", choices=list(PRESETS), default="cpu", help="size of data, network and training (cpu)")
    add("--pairs", type=Path, metavar="DIR", help="the paired dataset, if not DIR/pairs")
    add("--photographs", type=Path, action="append", default=[], metavar="FOLDER", help="more inputs; repeatable")
    add("--teacher", choices=["lut", "gradient"], default="lut", help="whose recolouring the network learns (lut)")
    add("--processes", type=int, default=os.cpu_count() or 1, metavar="N", help="processes that make pairs (all cores)")
    add("--device", choices=DEVICES, default="auto", help="where to train (auto)")
    add("--seed", type=int, default=0, metavar="N", help="seed of data and training (0)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting of the training, e.g. steps=5000 or generator.palette=false; repeatable",
    )
    add("--start", type=Path, metavar="FILE.safetensors", help="weights to start from; the network takes their shape")
    add(
        "--publish",
        type=Path,
        nargs="+",
        metavar="BENCH",
        help="ship DIR's weights, with a card of what BENCH measured",
    )
    add("--sweep", nargs="+", metavar="VARIANT", help=f"all, or some of: {', '.join(CHANGES)}")
    return parser


def train(options: argparse.Namespace, reporter: Reporter) -> None:
    """Make what is missing of the pairs, then train or sweep."""
    preset = PRESETS[options.preset]
    settings = changed(replace(preset.settings, seed=options.seed), _overrides(options.set))
    if options.start:
        settings = replace(settings, generator=load_generator(options.start).config)
    device = choose_device(options.device, has_cuda=torch.cuda.is_available())
    torch.set_float32_matmul_precision("high")  # TensorFloat-32 where there is any
    pairs = options.pairs or options.out / "pairs"
    if options.pairs is None:
        wanted = DatasetSettings(
            count=preset.samples,
            size=preset.size,
            seed=options.seed,
            teacher=options.teacher,
            processes=options.processes,
            photographs=tuple(str(folder) for folder in options.photographs),
        )
        make_dataset(pairs, wanted, reporter)
    dataset = PairedDataset(pairs)
    kept = range(0, len(dataset), VALIDATION_SHARE)
    validation = Examples(dataset, kept, reporter)
    examples = Examples(dataset, [i for i in range(len(dataset)) if i not in kept], reporter)
    if options.sweep:
        names = list(CHANGES) if options.sweep == ["all"] else options.sweep
        unknown = ", ".join(sorted(set(names) - set(CHANGES)))
        if unknown:
            raise InputError(f"no variant is called {unknown}", where="--sweep", remedy="see --help")
        base = settings if "steps" in _overrides(options.set) else replace(settings, steps=SWEEP_STEPS)
        sweep(options.out / "sweep", examples, validation, base, names, device, reporter)
        print((options.out / "sweep" / "sweep.md").read_text(encoding="utf-8"))
        return
    notes = {
        "settings": json.dumps(settings.to_dict()),
        "dataset": json.dumps(dataset.summary),
        "date": datetime.date.today().isoformat(),
        "device": f"{torch.get_num_threads()} processor cores without a GPU"
        if device == "cpu"
        else torch.cuda.get_device_name(),
    }
    if options.start:
        notes["start"] = json.dumps(read_notes(options.start))
    workers = _share_cores(settings, device)
    training = Training(options.out / "training", examples, validation, settings, device, workers, options.start)
    training.run(reporter, notes=notes)
    print(f"wrote {options.out / 'training'}")


def _share_cores(settings: TrainingSettings, device: str) -> int:
    """How many workers share a batch; on a CPU as many as it has cores, of one torch thread each."""
    cores = torch.get_num_threads()
    workers = max(n for n in range(1, cores + 1) if settings.batch % n == 0) if device == "cpu" else 1
    torch.set_num_threads(max(cores // workers, 1))
    return workers


def _overrides(assignments: list[str]) -> dict[str, Any]:
    """The settings of ``--set``; values are JSON."""
    known: Mapping[str, Any] = TrainingSettings().to_dict()
    result: dict[str, Any] = {}
    for assignment in assignments:
        name, _, value = assignment.partition("=")
        shape = name.removeprefix("generator.")
        if name not in known and not (name != shape and shape in known["generator"]):
            raise InputError(f"there is no setting {name!r}", where="--set", remedy=f"use one of {', '.join(known)}")
        try:
            parsed = json.loads(value)
        except json.JSONDecodeError:
            raise InputError(
                f"{value!r} is not a value for {name}", where="--set", remedy="give JSON, as in [3, 11]"
            ) from None
        result[name] = tuple(parsed) if isinstance(parsed, list) else parsed
    return result


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
