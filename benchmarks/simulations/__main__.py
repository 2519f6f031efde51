"""Judge clips that MuJoCo simulates, and say which errors the judge makes.

    python -m benchmarks.simulations [--seed 0] [--repeats 2] [--quick] [--only penguin hop]
    python -m benchmarks.simulations --dump penguin.hop.0.1 --fps 250 --out FOLDER

Two repeats of ten scenarios on seventeen bodies give about 300 simulations, each sampled at 60, 250
and 500 frames/s (at 30 and low-passed at 6 Hz for information). ``--alarms N`` tells about so
many errors what the validator and MuJoCo say of the worst frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.simulations.judge import (
    Judged,
    Take,
    dump,
    judged,
    mujoco_version,
    simulated,
    takes,
)
from benchmarks.simulations.models import NAMES
from benchmarks.simulations.scenarios import SCENARIOS

REQUIRED = (60, 250, 500)
WAYS = ((60, None), (250, None), (500, None), (30, None), (60, 6.0), (250, 6.0))
"""Frame rate and low-pass; the last three are for information."""


def run(chosen: Sequence[Take]) -> tuple[list[Judged], list[str]]:
    """Every take, judged in every way; and why some are no simulations."""
    results: list[Judged] = []
    refused = []
    for done, take in enumerate(chosen):
        if sys.stderr.isatty():
            print(f"\r{done}/{len(chosen)} {take.name:40s}", end="", file=sys.stderr)
        try:
            simulation = simulated(take)
        except RuntimeError as reason:
            refused.append(str(reason))
            continue
        results += [judged(take, simulation, fps, hz) for fps, hz in WAYS]
    return results, refused


def way(result: Judged) -> str:
    """The column a result belongs to."""
    return f"{result.fps}" + (f", {result.lowpass_hz:g} Hz" if result.lowpass_hz else "")


def table(results: Sequence[Judged], key: str) -> list[str]:
    """Clips with errors of all clips, by one side of the takes and by frame rate."""
    columns = list(dict.fromkeys(map(way, results)))
    lines = [
        f"| {key} | "
        + " | ".join(columns)
        + " | errors at 60, 250, 500 | other errors | causes | worst force | "
        "worst moment, RMS |",
        "|---" * (len(columns) + 6) + "|",
    ]
    groups: dict[str, list[Judged]] = defaultdict(list)
    for result in results:
        groups[getattr(result.take, key)].append(result)
    for name, group in {**groups, "all": list(results)}.items():
        cells = []
        for column in columns:
            there = [r for r in group if way(r) == column]
            cells.append(f"{sum(bool(r.alarms) for r in there)} of {len(there)}")
        plain = [r for r in group if r.fps in REQUIRED and r.lowpass_hz is None]
        told = counted(a.code for r in plain for a in r.alarms)
        others = counted(code for r in plain for code in r.others)
        causes = counted(code for r in plain for code in r.causes)
        worst = [
            max((r.residuals[m] for r in plain if m in r.residuals), default=float("nan"))
            for m in ("unexplained_force_max_bw", "unexplained_moment_rms_bwh")
        ]
        lines.append(
            f"| {name} | "
            + " | ".join(cells)
            + f" | {told} | {others} | {causes} | {worst[0]:.2f} BW | {worst[1]:.3f} BW·h |"
        )
    return lines


def counted(codes: Iterable[str]) -> str:
    """ "CON002 × 3, DYN001 × 1"."""
    return ", ".join(f"{code} × {n}" for code, n in sorted(Counter(codes).items())) or "–"


def tell(results: Sequence[Judged], count: int) -> list[str]:
    """The first alarms of each code, with the truth beside them."""
    lines = []
    by_code: dict[str, list[tuple[Judged, int]]] = defaultdict(list)
    for result in results:
        if result.fps in REQUIRED and result.lowpass_hz is None:
            for i, alarm in enumerate(result.alarms):
                by_code[alarm.code].append((result, i))
    for code, found in sorted(by_code.items()):
        # One of each body and scenario before a second one of any.
        seen: Counter[tuple[str, str]] = Counter()
        ranked: list[tuple[int, int, Judged, int]] = []
        for result, i in found:
            kind = (result.take.subject, result.take.scenario)
            ranked.append((seen[kind], len(ranked), result, i))
            seen[kind] += 1
        lines.append(f"{code}: {len(found)}")
        for _, _, result, i in sorted(ranked, key=lambda r: r[:2])[:count]:
            a = result.alarms[i]
            lines.append(f"  {result.take.name} at {way(result)}: {a.message}")
            if a.frame is not None and a.true_force is not None and a.seen_force is not None:
                touching = "; ".join(
                    f"{g} {d:+.2f} mm {n:.2f} BW" + (f", along {t:.2f}" if t > 0.005 else "")
                    for g, d, n, t in a.touches
                )
                lines.append(
                    f"      frame {a.frame}: floor truly {a.true_force:.2f} BW, over the frame "
                    f"{a.seen_force:.2f} BW; touches {touching or 'nothing'}"
                )
    return lines


def page(results: Sequence[Judged], refused: Sequence[str], command: str, seconds: float) -> str:
    """The whole as markdown."""
    clips = [r for r in results if r.lowpass_hz is None and r.fps in REQUIRED]
    wrong = sum(bool(r.alarms) for r in clips)
    count = len({r.take for r in results})
    return "\n".join(
        [
            "# Clips that MuJoCo simulates",
            "",
            f"Made by `{command}` with MuJoCo {mujoco_version()}, in {seconds:.0f} s of processor "
            "time. Whatever a forward simulation does is possible, so every error of the dynamics "
            "(DYN), of skating (CON002) or floating (CON003) is one of the judge.",
            "",
            f"**{count} simulations, {len(clips)} clips at 60, 250 and 500 frames/s: {wrong} with "
            "such errors.** Columns count clips with errors by frame rate; 30 frames/s and a "
            "low-pass of 6 Hz are for information. Other errors (a soft limit exceeded, a soft "
            "floor entered) may be true; none of the data (DAT, KIN003, KIN004) is, and no cause.",
            "",
            f"{len(refused)} more are left out: in their steps they break Newton's laws, since "
            "light limbs whirl or bodies that start within each other fly apart.",
            *(f"- {reason}" for reason in refused),
            "",
            *table(results, "subject"),
            "",
            *table(results, "scenario"),
            "",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeats", type=int, default=2, help="bodies of each kind")
    parser.add_argument("--quick", action="store_true", help="one body of each kind")
    parser.add_argument("--only", nargs="*", default=[], help="bodies and scenarios")
    parser.add_argument("--alarms", type=int, default=3, help="errors told of each code")
    parser.add_argument("--dump", metavar="TAKE", help="write model, clip and truth of a take")
    parser.add_argument("--fps", type=int, default=60, help="of the clip that is written")
    parser.add_argument("--out", type=Path, help="page to write; with --dump a folder")
    given = parser.parse_args()
    if given.dump:
        subject, scenario, seed, number = given.dump.split(".")
        take = Take(subject.replace("-", " "), scenario, int(seed), int(number))
        dump(take, given.fps, given.out or Path())
        return
    subjects = [n for n in NAMES if n in given.only or n.replace(" ", "-") in given.only]
    scenarios = [n for n in SCENARIOS if n in given.only]
    began = time.process_time()
    repeats = 1 if given.quick else given.repeats
    chosen = list(takes(given.seed, repeats, subjects or NAMES, scenarios or tuple(SCENARIOS)))
    results, refused = run(chosen)
    command = "python -m benchmarks.simulations " + " ".join(sys.argv[1:])
    text = page(results, refused, command.strip(), time.process_time() - began)
    if given.out:
        given.out.write_text(text, encoding="utf-8")
    print(text)
    print("\n".join(tell(results, given.alarms)))


if __name__ == "__main__":
    main()
