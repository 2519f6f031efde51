"""Contact phases found in marker captures against measured ground forces.

Run: python benchmarks/contact_plates.py FOLDER, which holds NAME.trc beside NAME_grf.mot.
A foot's force over 20 N is its contact. Prints, per trial, the share of frames that agree
for the left and the right foot and the error of each touch-down and lift-off, in ms, positive
if found late. Only contacts that begin and end within the trial have both; those that no plate
measured (a step beside it) are left out of the errors but not out of the agreement.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from physretarget.capture import load
from physretarget.contact import detect_phases
from physretarget.kinematics import runs


def table(path: Path) -> tuple[list[str], np.ndarray]:
    lines = path.read_text().splitlines()
    header = lines.index("endheader") + 1
    rows = [line.split() for line in lines[header + 1 :] if line.strip()]
    return lines[header].split(), np.array(rows, dtype=float)


def edges(found: np.ndarray, true: np.ndarray, time: np.ndarray) -> tuple[list, list]:
    """Errors (ms) of the starts and of the ends of the measured contacts that were found."""
    starts, ends = [], []
    for first, last in runs(true):
        for a, b in runs(found):
            if min(last, b) - max(first, a) > 0.3 * (last - first):
                if first > 0 and a > 0:
                    starts.append(1000 * (time[a] - time[first]))
                if last < len(time) - 1 and b < len(time) - 1:
                    ends.append(1000 * (time[b] - time[last]))
    return starts, ends


def main() -> None:
    every_start: list[float] = []
    every_end: list[float] = []
    for path in sorted(Path(sys.argv[1]).glob("*.trc")):
        motion = load(path)
        names, rows = table(path.with_name(path.stem + "_grf.mot"))
        force = [
            np.interp(motion.time, rows[:, 0], rows[:, names.index(f"ground_force_{k}_vy")]) > 20
            for k in (1, 2)
        ]
        active = detect_phases(motion).active
        feet = active[:, :2].any(axis=1), active[:, 2:4].any(axis=1)
        order = max((force, force[::-1]), key=lambda f: np.mean([feet[0] == f[0], feet[1] == f[1]]))
        agreement = [float((foot == plate).mean()) for foot, plate in zip(feet, order, strict=True)]
        errors = [edges(f, p, motion.time) for f, p in zip(feet, order, strict=True)]
        starts = errors[0][0] + errors[1][0]
        ends = errors[0][1] + errors[1][1]
        every_start += starts
        every_end += ends
        print(f"{path.stem:12s} left {agreement[0]:.3f}  right {agreement[1]:.3f}", end="  ")
        print("touch-down", np.round(starts).astype(int).tolist(), end="  ")
        print("lift-off", np.round(ends).astype(int).tolist())
    for label, errors_ms in (("touch-down", every_start), ("lift-off", every_end)):
        values = np.array(errors_ms)
        print(f"{label}: mean {values.mean():+.0f} ms, mean size {np.abs(values).mean():.0f} ms")


if __name__ == "__main__":
    main()
