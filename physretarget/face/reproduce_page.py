"""The figures of ``reproduce ruhland2017`` as Markdown, JSON and SVG, and one take's report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path

from physretarget import __version__
from physretarget.errors import InputError
from physretarget.face.report import take_report, write_report
from physretarget.face.reproduce import Reproduction, Row
from physretarget.files import write_file

PAPER_KEYS = {"capture": 145.21, "distance": 11.93, "sax": 16.74, "hmm": 17.88}
"""Ruhland et al. 2017, Figure 3: average keyframes of a 4-second clip."""

_TABLE_1 = (
    ("Expressiveness", "animation type", "F(4, 64) = 36.633, p ≈ 0",
     "artist highest; capture and synthesized alike"),
    ("Expressiveness", "emotion", "F(1, 16) = 8.434, p = 0.0103", "angry above happy"),
    ("Expressiveness", "type × emotion", "F(4, 64) = 12.992, p ≈ 0",
     "artist and HMM alike when angry"),
    ("Appeal", "animation type", "F(4, 64) = 21.588, p ≈ 0",
     "artist 5.25, capture 4.49, distance 4.2, HMM 3.67, SAX 3.55 of 7"),
    ("Cartooniness", "animation type", "F(4, 64) = 13.640, p ≈ 0", "artist highest"),
    ("Cartooniness", "type × sex of participant", "F(4, 64) = 4.109, p = 0.005",
     "women rated HMM and artist alike"),
    ("Cartooniness", "type × emotion", "F(4, 64) = 6.166, p = 0.0003",
     "HMM the best synthesized; alike artist when angry"),
    ("Message", "animation type", "F(4, 64) = 46.031, p ≈ 0",
     "artist and capture above synthesized"),
    ("Message", "emotion", "F(1, 16) = 18.335, p = 0.001", "angry above happy"),
    ("Message", "type × emotion", "F(4, 64) = 2.916, p = 0.028",
     "capture, distance, HMM alike when angry"),
)  # fmt: skip
_TABLE_2 = (
    ("Expressiveness", "animation type", "F(6, 72) = 10.123, p ≈ 0", "no significant improvement"),
    ("Expressiveness", "type × emotion", "F(6, 72) = 5.7226, p = 0.00007",
     "refined happy distance above unrefined"),
    ("Appeal", "animation type", "F(6, 72) = 11.364, p ≈ 0", "no improvement"),
    ("Cartooniness", "animation type", "F(6, 72) = 6.881, p = 0.00001", "artist highest"),
    ("Cartooniness", "type × emotion", "F(6, 72) = 5.521, p = 0.00009",
     "refined angry HMM as cartoony as artist"),
    ("Message", "animation type", "F(6, 72) = 14.201, p ≈ 0", "refined as well as capture"),
    ("Message", "type × emotion", "F(6, 72) = 5.202, p = 0.0002",
     "refined happy distance alike artist"),
)  # fmt: skip


def write_all(found: Reproduction, out: Path) -> tuple[Path, ...]:
    """Write into a folder, made if needed; returns the files.

    Raises:
        InputError: the folder cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}.", path=out) from error
    text = json.dumps(found.to_json(), indent=1, allow_nan=True) + "\n"
    names = ("ruhland2017.md", "ruhland2017.json", "figure3.svg", "take.html")
    write_file(out / names[0], markdown(found).encode())
    write_file(out / names[1], text.encode())
    write_file(out / names[2], figure_3(found).encode())
    result, rig = found.example
    write_report(out / names[3], take_report(result, rig))
    return tuple(out / name for name in names)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = True) -> str:
    marks = ["---"] + ["---:" if numbers else "---"] * (len(head) - 1)
    lines = [head, marks, *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def _cells(row: Row, *, own: bool = False) -> list[str]:
    measured = [
        f"{100 * row.error:.2f} %", f"{row.timing:.2f}", f"{row.spacing:.3f}", f"{row.handles:.3f}",
    ]  # fmt: skip
    return [
        row.name,
        row.placement,
        f"{row.keys:.2f} ± {row.spread:.2f}",
        *(["–"] * 4 if own else measured),
        f"{100 * row.flat:.0f} %",
        f"{100 * row.holds:.0f} %",
        "–" if own else f"{row.seconds:.2f}",
    ]


def _reading(found: Reproduction) -> str:
    """The comparison in words, whichever way it went in this run."""
    rows = {(r.name, r.placement): r for r in found.rows}
    lines = []
    for method in METHOD_ORDER:
        own, plain = rows[method, "optimal"], rows[f"decimate at {method}'s count", "optimal"]
        better = "less" if own.error < plain.error else "more"
        text = (
            f"- {method}, optimal placement: {own.keys:.1f} keys a curve; error to the capture "
            f"{100 * own.error:.2f} %, {better} than decimation's {100 * plain.error:.2f} % at the "
            f"same count; turning points off by {own.timing:.1f} against {plain.timing:.1f} frames"
        )
        told = {r.name: r for m, r in found.recovery if m == method}
        if told:
            gain = told[method].f1 - told["decimate"].f1
            ratio = told[method].error / max(told["decimate"].error, 1e-12)
            text += (
                f"; an unseen animator's keys: F1 {gain:+.3f} over decimation, error to the clean "
                f"curve {ratio:.2f} times decimation's"
            )
        lines.append(text + ".")
    return "\n".join(lines) + "\n"


def markdown(found: Reproduction) -> str:
    """The page."""
    lib = found.library
    dense = found.frames
    parts = [
        "# Ruhland, Prasad, McDonnell 2017, reproduced\n",
        f"physretarget {__version__}. Every number below is of this run, on {found.takes} takes of "
        f"4 s at 30 frames a second, {found.channels} channels each (lips left to the capture, as "
        f"in the paper), against a library of {lib['seconds']:.0f} s of hand-made animation "
        f"({lib['curves']:.0f} curves, {lib['keys']:.0f} keys, {lib['segments']:.0f} segments). "
        "What is quoted from the paper says so. The paper's rig, captures and library are not "
        "public, so these are other faces and another animator's keys.\n",
        "## Figure 3: keys of a 4-second take\n",
        "![Keys per curve](figure3.svg)\n",
        _table(
            ("", "the paper", "this run, greedy placement as the paper's", "optimal placement"),
            [("motion capture", f"{PAPER_KEYS['capture']}", f"{dense}", f"{dense}")]
            + [(m, f"{PAPER_KEYS[m]}", *_counts(found, m, dense)) for m in METHOD_ORDER],
        ),
        "Keys per curve and take; in brackets the share of the capture's keys that are gone.\n",
        "## What the count hides\n",
        "Plain reducers are given, channel by channel, the matcher's number of keys. Error: "
        "root mean square, of what the channel moves in the take. Turning points: mean distance in "
        "frames from the capture's to the result's nearest. Spacing (s) and handles (part of the "
        "span): Wasserstein distance to the library's distribution, 0 is the animators' own. Flat: "
        "share of flat tangents, holds: of held spans (both of key sides and spans that move less "
        "than 1 % of the curve's range). The library's own row counts keys per 4 s. Cost: seconds "
        "of computing per take, one process, this machine.\n",
        _table(
            ("", "placement", "keys", "error", "turning points", "spacing", "handles", "flat",
             "holds", "cost, s"),
            [_cells(row) for row in sorted(found.rows, key=lambda r: r.placement)]
            + [_cells(found.animator, own=True)],
        ),
        _reading(found),
        "## Are an unseen animator's keys found again?\n",
        f"{found.held_out} curves of shots that the library has not seen, nor any copy of them, "
        "as pseudo-captures: 60 frames a second, noise of 1 % of the range, frames up to one frame "
        "early or late. A key is found if within one frame. Reducers get the matcher's count.\n",
        _table(
            ("matcher", "output", "F1", "precision", "recall", "error to the clean curve", "keys"),
            [
                (m, r.name, f"{r.f1:.3f}", f"{r.precision:.3f}", f"{r.recall:.3f}",
                 f"{100 * r.error:.2f} %", f"{r.keys:.1f}")
                for m, r in found.recovery
            ],
        ),
        "## The paper's perception study (quoted, not repeated)\n",
        "18 people rated 20 clips on a 7-point scale (Table 1), 14 of them 5 clips that an "
        "animator had refined for 30 minutes each (Table 2). These are the paper's results about "
        "its own animations; nothing here was shown to anyone.\n",
        _table(("Table 1, unrefined", "effect", "F-test", "post hoc"), _TABLE_1, numbers=False),
        _table(("Table 2, refined", "effect", "F-test", "post hoc"), _TABLE_2, numbers=False),
        "## Inputs\n",
        _table(("file", "SHA-256"), [(escape(p), h[:16] + "…") for p, h in found.inputs]),
    ]  # fmt: skip
    return "\n".join(parts)


METHOD_ORDER = ("distance", "sax", "hmm")


def _counts(found: Reproduction, name: str, dense: int) -> list[str]:
    told = {row.placement: row.keys for row in found.rows if row.name == name}
    return [
        f"{told[place]:.2f} ({100 * (1 - told[place] / dense):.1f} %)"
        for place in ("greedy", "optimal")
    ]


def figure_3(found: Reproduction) -> str:
    """Bars as in the paper's figure: capture and three matchers, paper and this run."""
    groups = [("motion capture", [PAPER_KEYS["capture"], found.frames, found.frames])]
    for name in METHOD_ORDER:
        told = {row.placement: row.keys for row in found.rows if row.name == name}
        groups.append((name, [PAPER_KEYS[name], told["greedy"], told["optimal"]]))
    colours, labels = ("#b9c1cf", "#74a9d8", "#1971c2"), ("the paper", "greedy", "optimal")
    top = 1.12 * max(max(values) for _, values in groups)
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 330" role="img" '
        'font-family="system-ui, sans-serif" font-size="13">',
        "<title>Keys per curve of a 4-second take</title>",
        '<rect width="720" height="330" fill="#fff"/>',
    ]
    for g, (name, values) in enumerate(groups):
        left = 30 + 172 * g
        for k, value in enumerate(values):
            height, x = 240 * value / top, left + 46 * k
            parts.append(
                f'<rect x="{x}" y="{276 - height:.1f}" width="40" height="{height:.1f}" '
                f'fill="{colours[k]}"/><text x="{x + 20}" y="{270 - height:.1f}" '
                f'text-anchor="middle">{value:.2f}</text>'
            )
        parts.append(f'<text x="{left + 66}" y="296" text-anchor="middle">{name}</text>')
    for k, label in enumerate(labels):
        parts.append(
            f'<rect x="{400 + 100 * k}" y="14" width="14" height="12" fill="{colours[k]}"/>'
            f'<text x="{420 + 100 * k}" y="25">{label}</text>'
        )
    parts.append('<path d="M20 276.5H708" stroke="#596379"/></svg>\n')
    return "\n".join(parts)
