"""Are an unseen animator's keys found again? The table of docs/measured/face.md.

Run: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m benchmarks.face_keys
Words of the command line choose rows: ``noto 30 "1 % noise"``.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from physretarget.face.library import Example, Library
from physretarget.face.match import MatchSettings
from physretarget.face.recover import Recovery, difference, hold_out, recover, test_files

CAPTURES = {"1 % noise": {}, "3 % noise": {"noise": 0.03}}
SMOOTH = 1.0  # frames at 30 Hz
HEAD = (
    "collection", "Hz", "capture", "library", "programme alone", "other animators'", "RDP",
    "decimation", "Schneider", "library less programme (95 %, over files)", "flagged",
    "wrong if flagged", "wrong if not",
)  # fmt: skip
Question = tuple[Library, Library, tuple[Example, ...]]


def questions(data: Path) -> dict[str, list[Question]]:
    """Per collection: own library, other animators' library, curves that are asked for.

    Of Noto every third file is the test. Spine is one character of few files: each file is asked
    with the others as its library.
    """
    noto, spine = (Library.build([data / "keys" / name]) for name in ("noto", "spine"))
    rest, asked = hold_out(noto, test_files([e.shot for e in noto.examples]))
    found = {"noto": [(rest, spine, asked)], "spine": []}
    for shot in sorted({e.shot for e in spine.examples}):
        own, wanted = hold_out(spine, [shot])
        if wanted and own.examples:
            found["spine"].append((own, noto, wanted))
    return found


def pooled(parts: list[Recovery]) -> Recovery:
    """Several recoveries as one: means over all their curves."""
    first, *_ = parts
    if len(parts) == 1:
        return first
    total = sum(p.curves for p in parts)

    def mean(name: str) -> float:
        pairs = [(getattr(p, name), p.curves) for p in parts if getattr(p, name) is not None]
        return float(sum(v * n for v, n in pairs) / max(1, sum(n for _, n in pairs)))

    names = [f for f in Recovery.__dataclass_fields__ if f not in ("name", "curves", "by_file")]
    return Recovery(
        first.name,
        total,
        **{name: mean(name) for name in names},
        by_file=tuple(row for p in parts for row in p.by_file),
    )


def row(name: str, asked: list[Question], hz: float, capture: str) -> str:
    """One line of the table."""
    change = CAPTURES.get(capture, {"smooth": SMOOTH * hz / 30.0})
    ways: dict[str, list[Recovery]] = {"library": [], "alone": [], "other": []}
    plain: dict[str, list[Recovery]] = {}
    for own, other, wanted in asked:
        for way, library, learned in (
            ("library", own, True), ("alone", own, False), ("other", other, True),
        ):  # fmt: skip
            settings = MatchSettings(learned=learned)
            match, *reducers = recover(library, wanted, settings, fps=hz, **change)
            ways[way].append(match)
            if way == "library":
                for one in reducers:
                    plain.setdefault(one.name, []).append(one)
    best, alone, foreign = (pooled(found) for found in ways.values())
    gain, low, high = difference(best, alone)
    f1 = [w.f1 for w in (best, alone, foreign)]
    f1 += [pooled(plain[n]).f1 for n in ("rdp", "decimate", "schneider")]
    shares = [best.doubtful or 0.0]
    shares += [1 - (v or 0.0) for v in (best.right_if_doubtful, best.right_if_sure)]
    cells = [f"{name} ({best.curves})", f"{hz:g}", capture, *(f"{v:.3f}" for v in f1)]
    cells += [f"{gain:+.3f} ({low:+.3f} to {high:+.3f})", *(f"{100 * v:.0f} %" for v in shares)]
    return f"| {' | '.join(cells)} |"


def main(words: list[str]) -> None:
    """Print the table, or the rows that all the words are in."""
    data = Path(os.environ.get("PHYSRETARGET_DATA", "../shared/data"))
    print(f"| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}")
    for hz in (30.0, 60.0):
        for name, asked in questions(data).items():
            for capture in (*CAPTURES, "smoothed"):
                if all(w in (name, f"{hz:g}", capture) for w in words):
                    print(row(name, asked, hz, capture), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
