"""Trains the conditional GAN that predicts scene networks: from nothing to weights. Run it again to go on.

python scripts/train_enhancer.py out/weights                    what `make weights` does
python scripts/train_enhancer.py out/weights --steps 300        a try-out
python scripts/run.py CAPTURE --out DIR --enhancer out/weights/enhancer.safetensors
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch is loaded: see the Makefile
sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "core"))
import bootstrap

bootstrap.load(modules=("torch", "OpenImageIO"))
import torch

from cvdgs.core.errors import InputError
from cvdgs.core.runtime.cli import ConsoleReporter, OneLineParser, exit_code
from cvdgs.scripts.training.gan.training import WEIGHTS, Training, TrainingSettings
from cvdgs.scripts.training.model_card import publish
from cvdgs.scripts.training.report import write_report


def main(arguments: list[str]) -> int:
    """Train; returns the exit code."""

    def work() -> None:
        options = build_parser().parse_args(arguments)
        for name in ("steps", "threads"):
            if getattr(options, name) < 1:
                raise InputError(
                    f"{getattr(options, name)} is out of range", where=f"--{name}", remedy="give 1 or more"
                )
        train(options)

    return exit_code("train_enhancer.py", work, stopped="stopped; run again to go on")


def build_parser() -> argparse.ArgumentParser:
    """The options."""
    usual = TrainingSettings()
    parser = OneLineParser(
        prog="train_enhancer.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("out", type=Path, metavar="DIR", help="receives checkpoint, weights, log and pairs; what is there is used")
    add("--steps", type=int, default=usual.steps, metavar="N", help=f"of the schedule ({usual.steps})")
    add("--seed", type=int, default=usual.seed, metavar="N", help=f"of weights and scenes ({usual.seed})")
    add("--threads", type=int, default=1, metavar="N", help="of torch (1)")
    add("--publish", action="store_true", help="then ship the weights, with a model card")
    add("--report", type=Path, metavar="FOLDER", help="then write the curve and samples there")
    add("--no-adversary", action="store_true", help="without L_GAN, for comparison")
    return parser


def train(options: argparse.Namespace) -> None:
    """Train up to the last step."""
    torch.set_num_threads(options.threads)
    settings = replace(TrainingSettings(), steps=options.steps, seed=options.seed)
    if options.no_adversary:
        settings = replace(settings, adversarial_weight=0.0)
    notes = {"settings": json.dumps(settings.to_dict()), "date": datetime.date.today().isoformat()}
    Training(options.out, settings).run(ConsoleReporter(sys.stderr), notes)
    print(f"wrote {options.out / WEIGHTS}")
    if options.report:
        write_report(options.out, options.report)
    if options.publish:
        print(f"wrote {publish(options.out / WEIGHTS)}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
