"""Maya ``.anim`` (version 1.1), in and out, after Autodesk's "ANIM file format" page.

A key line is ``time value inType outType tangentLocked weightLocked breakdown`` and, for fixed
tangents only, ``angle weight`` of the in and then the out side. What angle and weight mean, and
the tangents of kinds that Maya computes, is in ``maya_tangents``. Values stay in the file's units
(degrees for angles); times are frames of the file's ``timeUnit`` and become seconds.

Channels are named ``node.attribute``. A comment ``// channel: name`` ahead of a curve, which Maya
skips, keeps names that Maya could not hold.

Written: a tangent keeps its kind only where Maya would compute the same one, else it is fixed, so
that shapes stay; angle and weight lose the last digit of a double. Infinity other than constant
is left out in reading and noted.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from typing import NoReturn

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats import maya_tangents
from physretarget.face.formats.source import Source
from physretarget.face.formats.tangents import evaluated, is_cubic_in_time
from physretarget.face.shot import Shot
from physretarget.files import write_file

_RATES = {
    "game": 15.0, "film": 24.0, "pal": 25.0, "ntsc": 30.0, "show": 48.0, "palf": 50.0,
    "ntscf": 60.0, "sec": 1.0, "millisec": 1000.0, "min": 1 / 60.0, "hour": 1 / 3600.0,
}  # fmt: skip
_KINDS: dict[str, TangentType] = {
    "fixed": "fixed", "linear": "linear", "flat": "flat", "smooth": "spline", "spline": "spline",
    "auto": "auto", "autoease": "auto", "automix": "auto", "autocustom": "auto",
    "step": "stepped", "stepnext": "stepped_next", "clamped": "fixed", "plateau": "fixed",
    "slow": "fixed", "fast": "fixed",
}  # fmt: skip
_WRITTEN = {"linear": "linear", "flat": "flat", "spline": "spline", "auto": "auto"}


@dataclass(frozen=True)
class _Statement:
    """Words up to a ``;``, ``{`` or ``}``; ``line`` counts from 1."""

    words: tuple[str, ...]
    end: str
    line: int


@dataclass
class _Block:
    """One animData while it is read."""

    name: str
    line: int
    rate: float
    flags: int = 7
    weighted: bool = False
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_maya(path: str | PathLike[str] | Source) -> Shot:
    """Read every curve over time; curves driven by another attribute are noted and left out.

    Raises:
        InputError: with the line.
    """
    source = path if isinstance(path, Source) else Source.open(path)
    text = source.text()
    statements = list(_statements(source, text))
    if not any(s.words[:1] == ("animVersion",) for s in statements):
        _fail(source, 1, "animVersion is missing; this is no Maya .anim file.")
    # Version 1.0 has no breakdown flag: six words come before the angles, else seven.
    flags = 6 if any(s.words == ("animVersion", "1.0") for s in statements) else 7
    unit, curves, notes = "", dict[str, Curve](), list[str]()
    rate, told, name, at = 24.0, "", "", 0
    while at < len(statements):
        words, line = statements[at].words, statements[at].line
        if words[:1] == ("timeUnit",) and not curves:
            unit = words[1] if len(words) > 1 else ""
            rate = _rate(source, line, unit)
        elif words[:1] == ("//channel",):
            told = " ".join(words[1:])
        elif words[:1] == ("anim",):
            name = _name(source, line, words)  # lines without animData name channels at rest
        elif words[:1] == ("animData",) and statements[at].end == "{":
            block = _Block(told or name or f"curve{len(curves)}", line, rate, flags)
            at = _block(source, statements, at + 1, block)
            if block.name in curves:
                _fail(source, line, f"{block.name} is animated twice.")
            if block.rows:
                curves[block.name] = _curve(source, block)
            notes += block.notes
            told = name = ""
        at += 1
    fps = rate if unit not in ("", "sec", "millisec", "min", "hour") else None
    return Shot(source.path.stem, curves, fps, source.sha256, tuple(notes))


def _fail(source: Source, line: int, message: str) -> NoReturn:
    raise InputError(message, path=source.path, line=line)


def _statements(source: Source, text: str) -> Iterator[_Statement]:
    depth = 0
    for number, raw in enumerate(text.splitlines(), 1):
        told = re.match(r"\s*//\s*channel:\s*(.+?)\s*$", raw)
        if told:
            yield _Statement(("//channel", told[1]), ";", number)
            continue
        code = re.split(r"//|#", raw, maxsplit=1)[0]
        for part in re.findall(r"[^;{}]*[;{}]?", code):
            words, end = part.rstrip(";{}").split(), part[-1:] if part[-1:] in ";{}" else ""
            depth += (end == "{") - (end == "}")
            if depth < 0:
                _fail(source, number, "a } without its {.")
            if words or end in ("{", "}"):
                yield _Statement(tuple(words), end, number)
    if depth:
        _fail(source, text.count("\n") + 1, "the file ends inside a block.")


def _rate(source: Source, line: int, unit: str) -> float:
    told = re.fullmatch(r"(\d+(?:\.\d+)?)(?:df|fps|ndf)", unit)
    rate = float(told[1]) if told else _RATES.get(unit, 0.0)
    if not 0 < rate < 1e6:
        _fail(source, line, f"timeUnit {unit!r} is not known; it is one of {', '.join(_RATES)}.")
    return rate


def _name(source: Source, line: int, words: tuple[str, ...]) -> str:
    """``anim [fullAttribute leafAttribute] node row child attribute``; no attribute: no curve."""
    if len(words) not in (5, 7):
        _fail(source, line, f"anim with {len(words) - 1} words; there are 4 or 6.")
    return f"{words[3]}.{words[2]}" if len(words) == 7 else words[1]


def _block(source: Source, statements: list[_Statement], at: int, block: _Block) -> int:
    """Read up to the closing brace; returns its place."""
    in_keys = False
    for place in range(at, len(statements)):
        statement = statements[place]
        words, line = statement.words, statement.line
        if statement.end == "}":
            if not in_keys:
                return place
            in_keys = False
        elif words[:1] == ("keys",):
            in_keys = True
        elif in_keys:
            block.rows.append((line, list(words)))
        else:
            _setting(source, line, words, block)
    _fail(source, block.line, f"{block.name}: its animData is not closed.")


def _setting(source: Source, line: int, words: tuple[str, ...], block: _Block) -> None:
    if len(words) < 2:
        return
    key, value = words[0], words[1]
    if key == "weighted":
        block.weighted = value == "1"
    elif key == "inputUnit":
        block.rate = _rate(source, line, value)
    elif key == "input" and value != "time":
        block.notes.append(f"{block.name}: driven by another attribute, not by time; left out.")
        block.name = f"{block.name}#driven{line}"
    elif key in ("preInfinity", "postInfinity") and value != "constant":
        block.notes.append(f"{block.name}: {key} {value} is left out; it holds its end values.")


def _number(source: Source, line: int, block: _Block, index: int, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        _fail(source, line, f"{block.name}, key {index}: {word[:40]!r} is not a number.")
    if not math.isfinite(value):
        _fail(source, line, f"{block.name}, key {index}: the number is not finite.")
    return value


@dataclass(frozen=True)
class _Row:
    """A key line as it stands; angle (deg) and weight are (0, 0) where not given."""

    time: float
    value: float
    kinds: tuple[str, str]
    locked: bool
    given: tuple[tuple[float, float], tuple[float, float]]


def _row(source: Source, block: _Block, index: int, line: int, words: list[str]) -> _Row:
    if len(words) < 6:
        _fail(source, line, f"{block.name}, key {index}: {len(words)} words, at least 6 needed.")
    for kind in words[2:4]:
        if kind not in _KINDS:
            _fail(
                source,
                line,
                f"{block.name}, key {index}: tangent {kind!r}; it is one of {', '.join(_KINDS)}.",
            )
    needed = block.flags + 2 * words[2:4].count("fixed")
    if len(words) != needed:
        _fail(source, line, f"{block.name}, key {index}: {len(words)} words where {needed} belong.")
    rest = [_number(source, line, block, index, w) for w in words[block.flags :]]
    given = []
    for kind in words[2:4]:
        given.append((rest.pop(0), rest.pop(0)) if kind == "fixed" else (0.0, 0.0))
    time, value = (_number(source, line, block, index, w) for w in words[:2])
    return _Row(
        time / block.rate, value, (words[2], words[3]), words[4] != "0", (given[0], given[1])
    )


def _curve(source: Source, block: _Block) -> Curve:
    rows = [_row(source, block, k, line, w) for k, (line, w) in enumerate(block.rows)]
    points = [(r.time, r.value) for r in rows]
    for k in range(1, len(rows)):
        if points[k][0] <= points[k - 1][0]:
            _fail(source, block.rows[k][0], f"{block.name}, key {k}: its time does not increase.")
    keys = []
    for k, row in enumerate(rows):
        into, out = (_offset(block.weighted, row, points, k, side) for side in (-1, 1))
        kinds = (_KINDS[row.kinds[0]], _KINDS[row.kinds[1]])
        keys.append(Key(row.time, row.value, into, out, *kinds, not row.locked))
    try:
        return Curve(tuple(keys), block.weighted)
    except InputError as error:
        _fail(source, block.line, f"{block.name}: {error}")


def _offset(
    weighted: bool, row: _Row, points: list[tuple[float, float]], k: int, side: int
) -> tuple[float, float]:
    which = 0 if side < 0 else 1
    kind = row.kinds[which]
    if kind in ("step", "stepnext"):
        return (0.0, 0.0)
    if kind in ("slow", "fast"):
        kind = "spline"
    if kind != "fixed":
        computed = {"smooth": "spline", "autoease": "auto", "automix": "auto", "autocustom": "auto"}
        return maya_tangents.tangent(computed.get(kind, kind), points, k, side)
    angle, weight = row.given[which]
    dx, dy = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    if weighted:
        return (side * max(weight * dx, 0.0), side * weight * dy)
    if not 0 <= k + side < len(points):
        return (side * max(dx, 0.0) / 3.0, side * dy / 3.0)
    third = (points[k + side][0] - row.time) / 3.0
    # animEngine's steepest unweighted tangent, so that 90 degrees stay finite.
    slope = dy / dx if dx * 5729577.9485111479 > abs(dy) else math.copysign(5729577.9485111479, dy)
    return (third, slope * third)


def write_maya(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write a shot; returns what was lost, one sentence each."""
    losses: list[str] = []
    unit, rate = _unit(shot.fps)
    last = max((c.end for c in shot.curves.values()), default=0.0) * rate
    first = min((c.start for c in shot.curves.values()), default=0.0) * rate
    lines = [
        "animVersion 1.1;",
        "mayaVersion 2024;",
        f"timeUnit {unit};",
        "linearUnit cm;",
        "angularUnit deg;",
        f"startTime {first!r};",
        f"endTime {last!r};",
    ]
    for index, (name, curve) in enumerate(shot.curves.items()):
        if re.search(r"[\r\n]", name):
            losses.append(f"{name!r}: line breaks in a name become spaces.")
        lines += _written(" ".join(name.split()), index, curve, rate, losses)
    write_file(path, ("\n".join(lines) + "\n").encode())
    return tuple(losses)


def _unit(fps: float | None) -> tuple[str, float]:
    if fps is None:
        return "sec", 1.0
    for unit, rate in _RATES.items():
        if rate == fps and rate >= 15 and unit != "millisec":
            return unit, rate
    return (f"{fps:.15g}fps", fps) if float(f"{fps:.15g}") == fps else ("sec", 1.0)


def _written(name: str, index: int, curve: Curve, rate: float, losses: list[str]) -> list[str]:
    node, _, attribute = name.partition(".")
    node = re.sub(r"\W", "_", node) or "node"
    attribute = re.sub(r"\W", "_", attribute) or "value"
    tangents = evaluated(curve)
    free = [k.out_type not in ("stepped", "stepped_next") for k in curve.keys[:-1]]
    weighted = curve.weighted or not bool(is_cubic_in_time(curve)[free].all())
    if tangents.shortened:
        losses.append(f"{name}: {len(tangents.shortened)} tangents that crossed are shortened.")
    points = [(k.time, k.value) for k in curve.keys]
    rows, changed = [], 0
    for k, key in enumerate(curve.keys):
        words = [repr(key.time * rate), repr(key.value)]
        sides = []
        offsets = (tangents.into[k], tangents.out[k])
        for which, kind in enumerate((key.in_type, key.out_type)):
            dx, dy = (float(x) for x in offsets[which])
            label = _label(kind, points, k, 2 * which - 1, (dx, dy))
            changed += label == "fixed" and kind in _WRITTEN
            words.append(label)
            if label == "fixed":
                # A handle of no length has no angle of its own: it takes the other side's.
                lean = offsets[which] if dx or dy else offsets[1 - which]
                side = 2 * which - 1 if dx or dy else 1 - 2 * which
                angle = math.degrees(math.atan2(side * lean[1], side * lean[0] + 0.0))
                sides += [repr(angle + 0.0), repr(math.hypot(dx, dy))]
        words += ["0" if key.broken else "1", "0", "0", *sides]
        rows.append("    " + " ".join(words) + ";")
    if changed:
        losses.append(f"{name}: {changed} tangents that Maya would compute otherwise are fixed.")
    return [
        f"// channel: {name}",
        f"anim {attribute} {attribute} {node} 0 {index} 0;",
        "animData {",
        "  input time;",
        "  output unitless;",
        f"  weighted {int(weighted)};",
        "  preInfinity constant;",
        "  postInfinity constant;",
        "  keys {",
        *rows,
        "  }",
        "}",
    ]


def _label(
    kind: TangentType,
    points: list[tuple[float, float]],
    k: int,
    side: int,
    offset: tuple[float, float],
) -> str:
    """Maya's word; a computed kind stays only where Maya computes this very tangent."""
    if kind in ("stepped", "stepped_next"):
        if side < 0:
            return "fixed"  # Maya steps by out tangents; this side's span is held by the other key
        return "step" if kind == "stepped" else "stepnext"
    if kind not in _WRITTEN:
        return "fixed"
    theirs = maya_tangents.tangent(_WRITTEN[kind], points, k, side)
    size = 1e-12 * (abs(offset[0]) + abs(offset[1]) + abs(points[k][1]))
    same = all(abs(a - b) <= size for a, b in zip(theirs, offset, strict=True))
    return _WRITTEN[kind] if same else "fixed"
