"""The command ``python -m physretarget.groundtruth FOLDER``; ``--help`` names its options."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from physretarget.errors import PhysretargetError
from physretarget.groundtruth.compare import with_weight_of_impulse
from physretarget.groundtruth.page import DEFAULT_HZ, judge, write_page
from physretarget.groundtruth.trial import load_plate_trial, load_trials


def main(arguments: list[str] | None = None) -> int:
    """Print one line per trial and write the page where one is asked for; 2 on unusable input."""
    parser = argparse.ArgumentParser(prog="python -m physretarget.groundtruth")
    parser.add_argument("folder", type=Path, help="pairs NAME.trc and NAME_grf.mot")
    parser.add_argument("--out", type=Path, help="page to write; pictures go to images/ beside it")
    parser.add_argument("--weight", type=float, help="body weight, N (by default of static*.trc)")
    parser.add_argument("--lowpass", type=float, default=DEFAULT_HZ, help="Hz")
    parser.add_argument(
        "--also", type=Path, action="append", default=[], metavar="C3D",
        help="a trial of another body with its plates in the file; its weight from the impulse",
    )  # fmt: skip
    told = parser.parse_args(arguments)
    try:
        trials = load_trials(told.folder, weight=told.weight)
        others = [
            with_weight_of_impulse(load_plate_trial(path, weight=700.0), hz=told.lowpass)
            for path in told.also
        ]
        if told.out:
            write_page(trials, told.out, others=others, hz=told.lowpass)
            print(f"{told.out} written from {len(trials) + len(others)} trials")
            return 0
        for trial in (*trials, *others):
            one = judge(trial, hz=told.lowpass).at(told.lowpass).vertical
            r = "–" if one.r is None else f"{one.r:.3f}"
            print(f"{trial.name:14s} vertical RMSE {one.rmse:.3f} BW  bias {one.bias:+.3f}  r {r}")
    except PhysretargetError as error:
        print(f"physretarget: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
