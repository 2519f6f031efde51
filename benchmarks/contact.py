"""How still planted points hold after contact, and how deep they are.

Prints the first table of docs/measured/contact.md.

    python -m benchmarks.contact [--data FOLDER]

Captures: those of the pybullet wheel, and of FOLDER ($PHYSRETARGET_DATA) where it is present; all
stages up to contact with the characters' own key poses. The actor is planted in its own motion.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from benchmarks.stream import captures, learned
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.contact import Contacted, adjust, detect_phases
from physretarget.mjcf.actor import actor_character
from physretarget.pipeline import RetargetSettings, retarget


def row(name: str, found: dict[str, Contacted]) -> None:
    """Median and worst capture's slide and sink, mm, as a line of the table."""
    cells = [name, str(len(found))]
    for which in ("slide_max_m", "sink_max_m"):
        most = {capture: 1e3 * float(getattr(one, which)) for capture, one in found.items()}
        worst = max(most, key=lambda capture: most[capture])
        cells.append(f"{np.median(list(most.values())):.2f}")
        cells.append(f"{most[worst]:.2f} ({worst})")
    print("| " + " | ".join(cells) + " |", flush=True)


def contacted(name: str, motions: dict[str, ActorMotion]) -> dict[str, Contacted]:
    """Every capture after contact."""
    mapper, settings = learned(name), RetargetSettings(until="contacted")
    found = {c: retarget(m, mapper, settings=settings).contacted for c, m in motions.items()}
    return {capture: one for capture, one in found.items() if one is not None}


def main() -> None:
    """The table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=os.environ.get("PHYSRETARGET_DATA"))
    told = options.parse_args()
    motions = dict(captures(Path(told.data) if told.data else None))
    head = ["character", "captures", "slide, mm: median capture", "worst"]
    head += ["sink, mm: median capture", "worst"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for name in ("lamp", "penguin", "squirrel"):
        row(name, contacted(name, motions))
    actor = actor_character(ActorShape.reference())
    own = {c: adjust(actor, m.qpos, m.time, detect_phases(m)) for c, m in motions.items()}
    row("the actor itself", own)


if __name__ == "__main__":
    main()
