"""The report's tables, from the pieces of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from physretarget.mjcf import Character
from physretarget.report.words import number
from physretarget.reproduce.explain import Performance, circumstances, explain
from physretarget.reproduce.plan import (
    PAPER_COMPUTING_SECONDS,
    PAPER_SECONDS,
    PAPER_TABLE_1,
    STYLES,
)
from physretarget.reproduce.results import Results
from physretarget.reproduce.store import Piece
from physretarget.reproduce.takes import PENETRATION_LIMIT, SKATE_LIMIT

Row = dict[str, Any]


def sequences(results: Results) -> dict[tuple[str, str], list[Piece]]:
    """The takes of each sequence (character, style), in the plan's order."""
    found: dict[tuple[str, str], list[Piece]] = {}
    for piece in results.takes.values():
        found.setdefault((piece.facts["character"], piece.facts["style"]), []).append(piece)
    return found


def table_1(results: Results) -> Row:
    """Seconds and key poses per style and character, the paper's beside them."""
    found = sequences(results)
    characters = results.plan.characters
    rows: list[Row] = []
    for style in (*STYLES, "dance"):
        cells = [
            _duration_and_poses(found[character, style])
            for character in characters
            if (character, style) in found
        ]
        if cells:
            rows.append({"style": style, "cells": cells})
    acted: list[list[Row]] = [row["cells"] for row in rows if row["style"] != "dance"]
    totals = [
        {"seconds": sum(r[k]["seconds"] for r in acted), "poses": sum(r[k]["poses"] for r in acted)}
        for k in range(len(characters))
    ]
    paper = [
        {"style": emotion, "cells": [cells[c] for c in characters]}
        for emotion, cells in PAPER_TABLE_1.items()
    ]
    paper_totals = [
        (
            sum(cells[c][0] for cells in PAPER_TABLE_1.values()),
            sum(cells[c][1] for cells in PAPER_TABLE_1.values()),
        )
        for c in characters
    ]
    learned = [
        next(p for p in results.takes.values() if p.facts["character"] == c).facts["all_key_poses"]
        for c in characters
    ]
    return {
        "characters": characters,
        "rows": rows,
        "totals": totals,
        "paper": paper,
        "paper_totals": paper_totals,
        "learned": learned,
    }


def _duration_and_poses(pieces: Sequence[Piece]) -> Row:
    return {
        "seconds": sum(p.facts["duration"] for p in pieces),
        "poses": sum(p.facts["key_poses"] for p in pieces),
        "takes": len(pieces),
    }


def physics(results: Results, characters: Mapping[str, Character]) -> list[Row]:
    """A row per sequence, its takes below it."""
    rows = []
    for (character, style), pieces in sequences(results).items():
        rows.append(
            {
                "character": character,
                "style": style,
                "takes": [_take_row(p, results, characters[character]) for p in pieces],
                **_physics_of(pieces),
            }
        )
    return rows


def _physics_of(pieces: Sequence[Piece]) -> Row:
    facts = [p.facts for p in pieces]
    frames = [f["frames"] for f in facts]

    def rms(name: str) -> float | None:
        known = [(f[name], n) for f, n in zip(facts, frames, strict=True) if f[name] is not None]
        if not known:
            return None
        values, weights = np.array(known, dtype=np.float64).T
        return float(np.sqrt(np.average(values**2, weights=weights)))

    before, after = rms("mismatch_before"), rms("mismatch_after")
    assert before is not None
    assert after is not None
    return {
        "seconds": sum(f["duration"] for f in facts),
        "before": before,
        "after": after,
        "fall": 1 - after / before,
        "bound": rms("bound"),
        "pull_before": rms("pull_before"),
        "pull_after": rms("pull_after"),
        "displacement": max(f["displacement"] / f["height"] for f in facts),
        "ballistic_before": rms("ballistic_before"),
        "ballistic_after": rms("ballistic_after"),
        "sink": max(f["sink"] for f in facts),
        "skate": max(f["skate"] for f in facts),
        "momentum": max(f["momentum_error"] for f in facts),
        "errors": sum(f["errors"] for f in facts),
        "warnings": sum(f["warnings"] for f in facts),
        "deepest": max(_deepest(f) for f in facts),
        "loaded_slide": max(f["measures"]["skate_speed_max_m_s"] or 0.0 for f in facts),
        "sinks": any(_deepest(f) > PENETRATION_LIMIT for f in facts),
        "skates": any(f["skate"] > SKATE_LIMIT for f in facts),
    }


def _deepest(facts: Row) -> float:
    """How deep anything is in the floor, m: any geometry that validation finds, any point."""
    found = facts["measures"]["penetration_max_m"]
    return max(float(facts["sink"]), float(found or 0.0))


def _take_row(piece: Piece, results: Results, character: Character) -> Row:
    facts = piece.facts
    folder = results.out / "takes" / str(facts["take"])
    found = json.loads((folder / "report.json").read_text("utf-8"))["findings"]
    with np.load(folder / "clip.npz", allow_pickle=False) as clip:
        performance = Performance(
            character, clip["time"], clip["qpos"], clip["contact_active"], piece.arrays["actor"]
        )
    codes = sorted(
        facts["codes"].items(), key=lambda each: (each[1]["severity"] != "error", -each[1]["count"])
    )
    return {
        "action": facts["action"],
        "page": f"takes/{facts['take']}/report.html",
        "codes": [
            {"code": code, "here": _here(code, found, performance), "why": explain(code), **about}
            for code, about in codes
        ],
        "notes": facts["notes"],
        **_physics_of([piece]),
    }


def _here(code: str, findings: Sequence[Row], performance: Performance) -> str:
    """What happens where a rule fires worst; nothing if it judges the clip as a whole."""
    worst = max(
        (f for f in findings if f["code"] == code and f.get("frame") is not None),
        key=lambda f: abs(f["value"] or 0.0),
        default=None,
    )
    return "" if worst is None else circumstances(code, worst["frame"], worst["body"], performance)


def mappers(results: Results) -> list[Row]:
    """Per character: a row per mapper, and what is to be said of the shared GPLVM."""
    tables = []
    for name, piece in results.studies["mappers"].items():
        height, rows = piece.facts["height"], piece.facts["rows"]
        best = {
            key: min(row[key] for row in rows)
            for key in ("seen", "pose", "take", "sequence", "jerk", "fastest")
        }
        tables.append(
            {
                "character": name,
                "height": height,
                "rows": rows,
                "best": best,
                "groups": piece.facts["groups"],
                "poses": piece.facts["poses"],
                "verdict": verdict(rows, height),
            }
        )
    return tables


WAYS = {"pose": "one key pose", "take": "one capture", "sequence": "one sequence"}


def verdict(rows: Sequence[Row], height: float) -> list[str]:
    """Is the shared GPLVM at least as good as each baseline, and if not, where and why."""
    own = next(row for row in rows if row["mapper"] == "sgplvm")
    others = [row for row in rows if row["mapper"] != "sgplvm"]
    said = []
    for key, way in WAYS.items():
        better = [row for row in others if row[key] < own[key]]
        if not better:
            nearest = min(others, key=lambda row: row[key])
            said.append(
                f"Leaving out {way}: the shared GPLVM is ahead of every baseline, "
                f"{_percent(own[key], height)} of the height against "
                f"{_percent(nearest[key], height)} ({nearest['mapper']})."
            )
            continue
        for row in better:
            lost = [
                s
                for s, value in row[f"{key}_by_sequence"].items()
                if value < own[f"{key}_by_sequence"][s]
            ]
            said.append(
                f"Leaving out {way}: {row['mapper']} is better, "
                f"{_percent(row[key], height)} of the height against "
                f"{_percent(own[key], height)}. It wins on {', '.join(lost)}: there the poses "
                "left out lie outside what the others show, and the latent search goes on "
                "along a direction that no key pose supports, while "
                + _why_better(str(row["mapper"]))
            )
    return said


def _why_better(mapper: str) -> str:
    if mapper.startswith("nn"):
        return "a weighted mean of posed poses never leaves them."
    if mapper == "gp":
        return "regression falls back to the mean pose."
    return "a linear map goes on along the main directions."


def _percent(metres: float, height: float) -> str:
    return f"{number(100 * metres / height)} %"


def losses(results: Results) -> list[str]:
    """Sequences in which a baseline beats the shared GPLVM although it loses on the whole."""
    found = []
    for name, piece in results.studies["mappers"].items():
        rows = piece.facts["rows"]
        own = next(row for row in rows if row["mapper"] == "sgplvm")["sequence_by_sequence"]
        beaten = []
        for sequence, value in own.items():
            best = min(
                (row for row in rows if row["mapper"] != "sgplvm"),
                key=lambda row: row["sequence_by_sequence"][sequence],
            )
            ratio = value / best["sequence_by_sequence"][sequence]
            if ratio > 1.01:
                beaten.append(f"{sequence} ({best['mapper']}, by {100 * (ratio - 1):.0f} %)")
        if beaten:
            found.append(f"{name}: {', '.join(beaten)}")
    return found


def fewer(results: Results) -> str:
    """Who reaches farthest without the extremes, in a sentence."""
    cases = [case for piece in results.studies["reach"].values() for case in piece.facts["cases"]]

    def ahead(other: str, key: str) -> int:
        by = [{row["mapper"]: row[key] for row in case["rows"]} for case in cases]
        return sum(one["sgplvm"] <= one[other] for one in by)

    counts = ", ".join(
        f"{other} in {ahead(other, 'height_error')} and {ahead(other, 'head_error')}"
        for other in ("gp", "pca", "nn3", "nn10")
    )
    return (
        f"Of {len(cases)} cases, the shared GPLVM is at least as near in height and in head "
        f"direction as {counts}."
    )


def cost(results: Results) -> Row:
    """Seconds of computing against the paper's."""
    facts = [piece.facts for piece in results.takes.values()]
    stages: dict[str, float] = {}
    for fact in facts:
        for stage, seconds in fact["seconds"].items():
            stages[stage] = stages.get(stage, 0.0) + seconds
    animated = sum(fact["duration"] for fact in facts)
    computing = sum(fact["computing"] for fact in facts)
    studies = sum(p.facts["seconds"] for found in results.studies.values() for p in found.values())
    return {
        "stages": stages,
        "animated": animated,
        "computing": computing,
        "per_second": computing / animated,
        "paper_per_second": PAPER_COMPUTING_SECONDS / PAPER_SECONDS,
        "faster": PAPER_COMPUTING_SECONDS / PAPER_SECONDS / (computing / animated),
        "studies": studies,
        "wall": results.seconds,
        "pieces": results.pieces,
        "resumed": results.resumed,
    }
