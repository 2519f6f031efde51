"""The figures of ``reproduce ruhland2017``: an HTML page, its numbers, one take's report."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path

from physretarget import __version__
from physretarget.errors import InputError
from physretarget.face.report import take_report, write_report
from physretarget.face.reproduce import WAYS, Asked, Reproduction, Row
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


METHOD_ORDER = ("distance", "sax", "hmm")
_CSS = """
:root { color-scheme: light dark; --ink: #1a2130; --soft: #596379; --line: #d9dee8; --bg: #fff;
  --panel: #f5f7fb; --good: #1b7f4b; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8ecf4; --soft: #9aa6bd; --line: #343c4d;
  --bg: #12161f; --panel: #1a202c; --good: #5fd39a; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--bg);
  max-width: 74rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; margin-bottom: .2rem; } h2 { margin-top: 2.4rem; font-size: 1.25rem; }
p, li { max-width: 46rem; } .soft { color: var(--soft); }
.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1.2rem 0; padding: 0; }
.tiles div { background: var(--panel); border: 1px solid var(--line); border-radius: .5rem;
  padding: .6rem 1rem; min-width: 11rem; } .tiles b { display: block; font-size: 1.35rem; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .88rem; margin: .8rem 0;
  font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid var(--line); padding: .3rem .5rem; text-align: right;
  white-space: nowrap; } th:first-child, td:first-child, .words td, .words th { text-align: left; }
.words td { white-space: normal; } th { color: var(--soft); font-weight: 600; }
tr.own td { font-weight: 600; } svg { max-width: 46rem; width: 100%; height: auto; display: block; }
svg text { fill: var(--ink); } svg .base { stroke: var(--soft); }
a { color: inherit; }
"""


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
    names = ("index.html", "ruhland2017.json", "take.html")
    write_file(out / names[0], page(found).encode())
    write_file(out / names[1], text.encode())
    result, rig, library = found.example
    write_report(out / names[2], take_report(result, rig, library))
    return tuple(out / name for name in names)


def _table(
    head: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False, own: int = 0
) -> str:
    """own: every so manieth row is this program's, set bold."""
    cells = "".join(f"<th scope=col>{escape(h)}</th>" for h in head)
    lines = []
    for k, row in enumerate(rows):
        kind = " class=own" if own and k % own == 0 else ""
        lines.append(f"<tr{kind}>" + "".join(f"<td>{escape(c)}</td>" for c in row) + "</tr>")
    style = " class=words" if words else ""
    return (
        f"<div class=wide><table{style}><thead><tr>{cells}</tr></thead>"
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _cells(row: Row, *, own: bool = False) -> list[str]:
    measured = [
        f"{100 * row.error:.2f} %", f"{row.timing:.2f}", f"{100 * row.missed:.1f} %",
        f"{row.spacing:.3f}", f"{row.handles:.3f}", f"{row.slopes:.3f}",
    ]  # fmt: skip
    return [
        row.name,
        f"{row.keys:.2f} ± {row.spread:.2f}",
        *(["–"] * 6 if own else measured),
        f"{100 * row.flat:.0f} %",
        f"{100 * row.holds:.0f} %",
        "–" if own else f"{row.seconds:.2f}",
    ]


def _gain(asked: Asked) -> float:
    named = {row.name: row.f1 for row in asked.rows}
    return named["match"] - named["rdp"]


def _tiles(found: Reproduction) -> str:
    own = next(r for r in found.rows if r.name == "default")
    tiles = [
        (f"{100 * (1 - own.keys / found.frames):.1f} %", "fewer keys (default)"),
        (f"{own.timing:.2f} frames", f"turning points off; {100 * own.missed:.1f} % not found"),
    ]
    for name in dict.fromkeys(a.collection for a in found.recovery):
        asked = [a for a in found.recovery if a.collection == name and a.variant == "default"]
        gains = [_gain(a) for a in asked]
        tiles.append(
            (f"{min(gains):+.2f} to {max(gains):+.2f}", f"F1 over RDP, unseen keys, {name}")
        )
    for name in dict.fromkeys(c.collection for c in found.controls):
        best = max((row for row in found.library_gain() if row[0] == name), key=lambda row: row[2])
        _, fps, gain, low, high = best
        words = f"F1 at most by the library, {name}, {fps:g} Hz ({low:+.3f} to {high:+.3f})"
        tiles.append((f"{gain:+.3f}", words))
    cells = (f"<div><b>{escape(a)}</b>{escape(b)}</div>" for a, b in tiles)
    return f"<div class=tiles>{''.join(cells)}</div>"


def _asked_row(a: Asked, name: str) -> list[str]:
    own, plain, fitted, best = a.rows
    ratio = own.error / max(plain.error, 1e-12)
    return [
        name, f"{own.f1:.3f}", f"{best.f1:.3f}", f"{plain.f1:.3f}", f"{fitted.f1:.3f}",
        f"{own.f1 - best.f1:+.3f}",
        f"{own.precision:.2f}", f"{own.recall:.2f}", f"{100 * own.error:.2f} %", f"{ratio:.2f}",
        f"{own.keys:.1f}",
    ]  # fmt: skip


_ASKED_HEAD = ("F1", "RDP", "decimation", "Schneider", "over RDP", "precision", "recall", "error",
               "× decimation's", "keys")  # fmt: skip


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.0f} %"


def _style_row(a: Asked) -> list[str]:
    own, plain, fitted, _ = a.rows
    return [
        f"{a.collection}, {a.fps:g} Hz, {a.variant}",
        *(f"{r.spacing:.3f}" for r in (own, plain, fitted)),
        *(f"{r.handles:.3f}" for r in (own, plain, fitted)),
        *(f"{r.slopes:.2f}" for r in (own, plain, fitted)),
        *(f"{100 * r.holds:+.0f}" for r in (own, plain, fitted)),
    ]


def page(found: Reproduction) -> str:
    """The page: one file, nothing loaded from anywhere."""
    lib, dense = found.library, found.frames
    counts = [("motion capture", f"{PAPER_KEYS['capture']}", f"{dense}")]
    counts += [
        (way, f"{PAPER_KEYS[m]}" if m else "–", _count(found, way, dense))
        for way, m in zip(WAYS, ("", *METHOD_ORDER), strict=True)
    ]
    three = ("own", "decimated", "Schneider")
    style_head = ["", *(f"{what}, {who}" for what in ("spacing", "handles", "slopes", "holds")
                        for who in three)]  # fmt: skip
    parts = [
        "<!doctype html><html lang=en><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>Ruhland 2017, reproduced</title><style>{_CSS}</style>",
        "<h1>An animator's keys from facial capture</h1>",
        "<p class=soft>Ruhland, Prasad and McDonnell, <i>Data-driven approach to synthesizing "
        f"facial animation using motion capture</i>, 2017. physretarget {__version__}.</p>",
        _tiles(found),
        f"<p>Every number below is of this run, on {found.takes} takes of 4 s at 30 frames a "
        f"second, {found.channels} channels each (lips left to the capture, as in the paper), "
        f"against a library of {lib['seconds']:.0f} s of hand-made animation ({lib['curves']:.0f} "
        f"curves, {lib['keys']:.0f} keys). What is quoted from the paper says so. The paper's rig, "
        "captures and library are not public, so these are other faces and other animators' keys. "
        "<a href='take.html'>One take on timelines: click a key for its source.</a></p>",
        "<h2>Figure 3: keys of a 4-second take</h2>",
        figure_3(found),
        _table(("", "the paper", "this run"), counts),
        "<p class=soft>Keys per curve and take; in brackets the share of the capture's keys that "
        "are gone. ruhland2017: the paper as written, threshold 0.05.</p>",
        "<h2>What the count hides</h2>",
        "<p>Plain reducers are given, channel by channel, the matcher's number of keys. Error: "
        "root mean square, of what the channel moves. Turning points (standing out by 10 %): "
        "frames off, plateaus taken as a whole, and share not found. Spacing (s), handles (part "
        "of the span) and slopes: Wasserstein distance to the library's own, 0 is the animators'. "
        "Flat tangents, held spans: shares. Cost: seconds of computing per take.</p>",
        _table(
            ("", "keys", "error", "frames off", "not found", "spacing", "handles",
             "slopes", "flat", "holds", "cost, s"),
            [_cells(row) for row in found.rows] + [_cells(found.animator, own=True)],
            own=4,
        ),
        "<h2>Are an unseen animator's keys found again?</h2>",
        f"<p>{len(found.tested)} files were set aside, and no parameter was tuned on them; their "
        "curves, and all of the other collection's, are unknown to the library, copies included. "
        "They become pseudo-captures: noise of 1 % of the range, every frame up to one frame early "
        "or late. A key counts as found within one frame. Reducers get the matcher's count, curve "
        "by curve; error is to the clean curve.</p>",
        recovery_figure(found),
        _table(
            ("", *_ASKED_HEAD),
            [_asked_row(a, f"{a.collection}, {a.fps:g} Hz, {a.variant}") for a in found.recovery],
        ),
        "<h2>What does the library add?</h2>",
        "<p>The control is the same programme with nothing learned from the library. Intervals are "
        "over files, 95 %.</p>",
        _table(
            ("", "default", "programme alone", "difference in F1", "95 % interval"),
            [
                (f"{c.collection}, {c.fps:g} Hz", f"{c.rows[0].f1 + row[2]:.3f}",
                 f"{c.rows[0].f1:.3f}", f"{row[2]:+.3f}", f"{row[3]:+.3f} to {row[4]:+.3f}")
                for c, row in zip(found.controls, found.library_gain(), strict=True)
            ],
        ),
        "<h2>Are flagged pieces worse?</h2>",
        "<p>A piece is right if it begins and ends on keys of the animator's.</p>",
        _table(
            ("", "flagged", "right if flagged", "right if not"),
            [
                (f"{a.collection}, {a.fps:g} Hz, {a.variant}", _share(a.rows[0].doubtful),
                 _share(a.rows[0].right_if_doubtful), _share(a.rows[0].right_if_sure))
                for a in found.recovery
            ],
        ),
        "<h2>Style: how close to the unseen animator's keying</h2>",
        "<p>Wasserstein distances to the held-out curves' own spacing (s), handle lengths (part of "
        "the span) and slopes; held spans: percentage points more than the animators'.</p>",
        _table(style_head, [_style_row(a) for a in found.recovery]),
        "<h2>Under noise</h2>",
        "<p>The default at 30 Hz.</p>",
        _table(("", *_ASKED_HEAD), [_asked_row(a, a.variant) for a in found.variants]),
        "<h2>The paper's perception study (quoted, not repeated)</h2>",
        "<p>18 people rated 20 clips on a 7-point scale (Table 1), 14 of them 5 clips that an "
        "animator had refined for 30 minutes each (Table 2). These are the paper's results about "
        "its own animations; nothing here was shown to anyone.</p>",
        _table(("Table 1, unrefined", "effect", "F-test", "post hoc"), _TABLE_1, words=True),
        _table(("Table 2, refined", "effect", "F-test", "post hoc"), _TABLE_2, words=True),
        "<h2>Inputs</h2><details><summary>Files and their SHA-256</summary>",
        _table(("file", "SHA-256"), found.inputs, words=True),
        "</details></html>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def _count(found: Reproduction, way: str, dense: int) -> str:
    keys = next(row.keys for row in found.rows if row.name == way)
    return f"{keys:.2f} ({100 * (1 - keys / dense):.1f} %)"


def recovery_figure(found: Reproduction) -> str:
    """F1 of every matcher beside the reducers', per collection and frame rate."""
    groups: dict[tuple[str, float], list[Asked]] = {}
    for a in found.recovery:
        groups.setdefault((a.collection, a.fps), []).append(a)
    width = 30 + 172 * max(1, len(groups))
    parts = [
        f'<svg viewBox="0 0 {width} 250" role="img" font-family="system-ui" font-size="12">'
        "<title>F1 of unseen keys</title>"
    ]
    colours = ("#1971c2", "#2b8a3e", "#e67700", "#9c36b5", "#b9c1cf")
    labels = ("default", *(f"paper, {m}" for m in METHOD_ORDER), "RDP")
    for g, ((name, fps), members) in enumerate(groups.items()):
        first = members[0].rows
        values = [a.rows[0].f1 for a in members] + [first[3].f1]
        for k, value in enumerate(values):
            x, height = 30 + 172 * g + 29 * k, 180 * value
            parts.append(
                f'<rect x="{x}" y="{215 - height:.1f}" width="25" height="{height:.1f}" '
                f'fill="{colours[k]}"/><text x="{x + 12}" y="{210 - height:.1f}" '
                f'text-anchor="middle">{value:.2f}</text>'
            )
        parts.append(
            f'<text x="{100 + 172 * g}" y="234" text-anchor="middle">'
            f"{escape(name)}, {fps:g} Hz</text>"
        )
    for k, label in enumerate(labels):
        parts.append(
            f'<rect x="{30 + 110 * k}" y="4" width="12" height="12" fill="{colours[k]}"/>'
            f'<text x="{47 + 110 * k}" y="14">{label}</text>'
        )
    parts.append(f'<path class="base" d="M20 215.5H{width - 10}"/></svg>')
    return "".join(parts)


def figure_3(found: Reproduction) -> str:
    """Bars as in the paper's figure: capture and matchers, paper and this run."""
    told = {row.name: row.keys for row in found.rows}
    groups = [("motion capture", [PAPER_KEYS["capture"], float(found.frames)])]
    groups += [(m, [PAPER_KEYS[m], told[f"ruhland2017 {m}"]]) for m in METHOD_ORDER]
    groups.append(("default", [told["default"]]))
    colours = ("#74a9d8", "#1971c2")
    top = 1.12 * max(max(values) for _, values in groups)
    parts = [
        '<svg viewBox="0 0 760 330" role="img" font-family="system-ui" font-size="12">'
        "<title>Keys per curve of a 4-second take</title>"
    ]
    for g, (name, values) in enumerate(groups):
        for k, value in enumerate(values):
            own = k + (len(values) == 1)
            height, x = 240 * value / top, 30 + 146 * g + 44 * own
            parts.append(
                f'<rect x="{x}" y="{286 - height:.1f}" width="38" height="{height:.1f}" '
                f'fill="{colours[own]}"/><text x="{x + 19}" y="{280 - height:.1f}" '
                f'text-anchor="middle">{value:.1f}</text>'
            )
        parts.append(f'<text x="{71 + 146 * g}" y="306" text-anchor="middle">{name}</text>')
    for k, label in enumerate(("the paper", "this run")):
        parts.append(
            f'<rect x="{300 + 110 * k}" y="4" width="12" height="12" fill="{colours[k]}"/>'
            f'<text x="{317 + 110 * k}" y="14">{label}</text>'
        )
    parts.append('<path class="base" d="M20 286.5H750"/></svg>')
    return "".join(parts)
