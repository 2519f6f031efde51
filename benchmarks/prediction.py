"""Does the verdict predict the simulation? Validator beside MuJoCo, clip by clip.

    python -m benchmarks.prediction [--data FOLDER] [--seconds S] [--out PAGE.md]

Clips of the last stage, a robot's clips, and two of them with planted faults of growing size are
judged by inverse dynamics, then played forward without and with assist. A clip counts as bad where
the body is lost, the simulation keeps more than 5 % of the height away, or it needs more than 0.05
BW of help; rank correlations and areas under the ROC curve come with 95 % bootstrap intervals over
clips.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr

from benchmarks.simulate import collection
from physretarget.clip import Clip
from physretarget.kinematics import quat_multiply, rotvec_to_quat
from physretarget.mjcf import Character
from physretarget.options.simulation import SimulationOptions
from physretarget.simulate import settings_of, simulate
from physretarget.validation import validate

Array = NDArray[np.float64]

ONLY = (
    "lamp/others", "lamp/normal/run", "lamp/dance", "penguin/others", "penguin/normal/run",
    "penguin/dance", "squirrel/normal/run", "g1",
)  # fmt: skip
PLANTED_IN = ("penguin/others/walk", "g1/walk")
PREDICTORS = ("unexplained_force_rms_bw", "unexplained_moment_rms_bwh", "DYN errors")
BAD_DEVIATION, BAD_ASSIST = 0.05, 0.05
DRAWS = 2000
HEAD = (
    "| clip | DYN errors | unexplained force, BW RMS | moment, BW·h RMS | survived "
    "| deviation, % of height | assist, BW RMS | trackability | bad |\n" + "|---" * 9 + "|"
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One clip, judged and played."""

    name: str
    codes: tuple[str, ...]
    force: float
    moment: float
    survived: float
    deviation: float
    assist: float
    trackability: float

    @property
    def bad(self) -> bool:
        """Whether the simulation says that it cannot happen as it is."""
        lost = self.survived < 1.0
        return lost or self.deviation > BAD_DEVIATION or self.assist > BAD_ASSIST

    def predictor(self, name: str) -> float:
        """What the validator says, as a number."""
        if name == "DYN errors":
            return float(len(self.codes))
        return self.force if "force" in name else self.moment

    def __str__(self) -> str:
        codes = ", ".join(sorted(set(self.codes))) or "–"
        return (
            f"| {self.name} | {codes} | {self.force:.3f} | {self.moment:.3f} | "
            f"{100 * self.survived:.0f} % | {100 * self.deviation:.2f} | {self.assist:.3f} | "
            f"{self.trackability:.2f} | {'yes' if self.bad else ''} |"
        )


def faster(clip: Clip, character: Character, size: float) -> Clip:
    """Played `size` times as fast."""
    return replace(clip, time=clip.time / size)


def leaning(clip: Clip, character: Character, size: float) -> Clip:
    """Turned about the floor's y axis by `size` degrees, the root's height kept."""
    qpos, root = clip.qpos.copy(), character.root_qpos
    turn = rotvec_to_quat(np.tile([0.0, np.radians(size), 0.0], (len(qpos), 1)))
    qpos[:, root + 3 : root + 7] = quat_multiply(turn, qpos[:, root + 3 : root + 7])
    return replace(clip, qpos=qpos)


def bobbing(clip: Clip, character: Character, size: float) -> Clip:
    """The root moved up and down at 3 Hz, by `size` per cent of the height."""
    qpos = clip.qpos.copy()
    wave = 0.5 * (1 - np.cos(2 * np.pi * 3.0 * (clip.time - clip.time[0])))
    qpos[:, character.root_qpos + 2] += 0.01 * size * character.height * wave
    return replace(clip, qpos=qpos)


FAULTS: dict[str, tuple[Callable[[Clip, Character, float], Clip], tuple[float, ...]]] = {
    "× as fast": (faster, (1.25, 1.5, 2.0)),
    "° leaning": (leaning, (3.0, 6.0, 12.0)),
    "% bobbing": (bobbing, (1.0, 3.0, 9.0)),
}


def clips(data: Path, seconds: float) -> Iterator[tuple[str, Character, Clip]]:
    """The collection, each clip's first seconds, and faults in some of them."""
    for name, character, whole in collection(data, ONLY):
        kept = whole.time <= whole.time[0] + seconds
        clip = replace(
            whole, qpos=whole.qpos[kept], time=whole.time[kept], contact_active=None,
            contact_points=(),
        )  # fmt: skip
        yield name, character, clip
        if name in PLANTED_IN:
            for word, (change, sizes) in FAULTS.items():
                for size in sizes:
                    yield f"{name}, {size:g} {word}", character, change(clip, character, size)


def judged(name: str, character: Character, clip: Clip) -> Row:
    """Judge a clip, and play it twice."""
    report = validate(clip, character)
    exact = simulate(clip, character).measures
    helped = simulate(clip, character, settings_of(SimulationOptions(assist=True))).measures

    def value(measure: str) -> float:
        found = report.measures[measure].value
        return float("nan") if found is None else float(found)

    errors = [f.code for f in report.findings if f.severity == "error"]
    return Row(
        name=name,
        codes=tuple(code for code in errors if code.startswith("DYN")),
        force=value("unexplained_force_rms_bw"),
        moment=value("unexplained_moment_rms_bwh"),
        survived=exact.survived_s / exact.duration_s,
        deviation=exact.tracking_share,
        assist=helped.assist_force_rms_bw,
        trackability=replace(
            exact, assist_force_rms_bw=helped.assist_force_rms_bw
        ).trackability,
    )  # fmt: skip


def area(score: Array, bad: NDArray[np.bool_]) -> float:
    """Chance that a bad clip scores higher than a good one, ties half: the area under the ROC."""
    good = int((~bad).sum())
    if not good or good == len(bad):
        return float("nan")
    ranks = rankdata(score)[bad]
    return float((ranks.mean() - 0.5 * (len(ranks) + 1)) / good)


def interval(statistic: Callable[[NDArray[np.int64]], float], number: int) -> str:
    """A statistic of all clips with its 95 % bootstrap interval."""
    random = np.random.default_rng(0)
    draws = [statistic(random.integers(number, size=number)) for _ in range(DRAWS)]
    low, high = np.nanpercentile(draws, [2.5, 97.5])
    return f"{statistic(np.arange(number)):.2f} ({low:.2f} to {high:.2f})"


def statistics(rows: list[Row]) -> list[str]:
    """How well each figure of the validator predicts what the simulation does."""
    bad = np.array([row.bad for row in rows])
    outcomes = {
        "assist": np.array([row.assist for row in rows]),
        "deviation": np.array([row.deviation for row in rows]),
        "1 - trackability": np.array([1 - row.trackability for row in rows]),
    }
    lines = [
        "| | " + " | ".join(f"Spearman with {name}" for name in outcomes) + " | area under ROC |",
        "|---" * (len(outcomes) + 2) + "|",
    ]
    for name in PREDICTORS:
        score = np.array([row.predictor(name) for row in rows])
        cells = [
            interval(lambda at, s=score, o=o: float(spearmanr(s[at], o[at]).statistic), len(rows))  # type: ignore[misc]
            for o in outcomes.values()
        ]
        cells.append(interval(lambda at, s=score: area(s[at], bad[at]), len(rows)))  # type: ignore[misc]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


def disagreements(rows: list[Row]) -> list[str]:
    """Clips that one of the two refuses and the other does not."""
    missed = [row.name for row in rows if row.bad and not row.codes]
    alarms = [row.name for row in rows if row.codes and not row.bad]
    both = sum(row.bad and bool(row.codes) for row in rows)
    neither = sum(not row.bad and not row.codes for row in rows)
    return [
        f"Of {len(rows)} clips, {both} are refused by both and {neither} by neither.",
        "",
        f"- No DYN error, yet bad in simulation ({len(missed)}): {'; '.join(missed) or 'none'}.",
        f"- DYN errors, yet good in simulation ({len(alarms)}): {'; '.join(alarms) or 'none'}.",
    ]


def main() -> None:
    """Judge and play the clips; print and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("PHYSRETARGET_DATA", str(beside)))
    )
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--out", type=Path)
    told = parser.parse_args()
    print(HEAD)
    rows = []
    for name, character, clip in clips(told.data, told.seconds):
        rows.append(judged(name, character, clip))
        print(rows[-1], flush=True)
    parts = [*statistics(rows), "", *disagreements(rows)]
    print("\n" + "\n".join(parts))
    if told.out is not None:
        text = (
            "# Does the verdict predict the simulation?\n\nMade by `python -m "
            f"benchmarks.prediction`: the first {told.seconds:g} s of clips of three characters "
            "and a robot, and planted faults of growing size; what inverse dynamics says beside "
            "what MuJoCo does. Bad: the body is lost, or the simulation keeps more than "
            f"{100 * BAD_DEVIATION:g} % of the height away, or needs more than {BAD_ASSIST:g} BW "
            "of help. In brackets 95 % bootstrap intervals over clips.\n\n"
            + "\n".join([*parts, "", HEAD, *map(str, rows)])
            + "\n"
        )
        told.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
