"""What happens in a face, across channels: blinks, eye darts, brow hits, jaw drops, nods, holds.

Events are read off keyed curves, a result's or any shot's, so that each one knows its keys and can
be moved as a whole. A channel that leaves its level and comes back makes an excursion, one that
goes and stays makes a move; both must be a share of what the channel moves, and as quick as the
thing they are named for. Excursions of several channels of a group whose peaks stand close together
are one event.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.reduce import reduce_curve
from physretarget.face.shot import Shot

Array = NDArray[np.float64]
EventKind = Literal["blink", "eye dart", "brow hit", "jaw drop", "nod", "hold"]
_TOGETHER = 0.1  # s between the peaks of channels that move as one
_DENSE_HZ = 12.0  # keys a second above which a curve is a recording; it is thinned to be read
_THINNED = 0.05  # largest error in that, of what the channel moves


@dataclass(frozen=True)
class _Rule:
    """What counts as an event of a kind.

    words: one of them is in a channel's name. returns: whether the channel comes back. height:
    least, as a share of what the channel moves in the whole shot. longest: seconds.
    """

    group: str
    words: tuple[str, ...]
    returns: bool
    height: float
    longest: float


RULES: dict[EventKind, _Rule] = {
    "blink": _Rule("lids", ("blink", "eyelopen", "eyeropen", "eyeopen"), True, 0.5, 0.5),
    "eye dart": _Rule("gaze", ("",), False, 0.15, 0.2),
    "brow hit": _Rule("brows", ("",), True, 0.4, 1.0),
    "jaw drop": _Rule("lips", ("jawopen", "mouthopen", "jawdrop"), True, 0.5, 1.5),
    "nod": _Rule("head", ("pitch", "rotation.x", "angley", "nod"), True, 0.3, 1.2),
}
"""Blinks last 0.1 to 0.4 s (Stern, Walrath and Goldstein, 1984), saccades of up to 60 degrees less
than 0.2 s (Bahill, Clark and Stark, 1975); the rest is a convention."""
HOLD = 0.5
"""Seconds that a face holds still at least, all keyed channels at once."""


@dataclass(frozen=True)
class Event:
    """One event.

    Attributes:
        kind: what happens.
        start, peak, end: seconds. A move's peak is its end, a hold's its start.
        keys: per channel the numbers of its first and last key; what moves when the event is moved
            are those keys.
        height: of the highest channel, as a share of what it moves.
    """

    kind: EventKind
    start: float
    peak: float
    end: float
    keys: Mapping[str, tuple[int, int]]
    height: float

    @property
    def channels(self) -> tuple[str, ...]:
        """Who takes part."""
        return tuple(self.keys)


def find_events(curves: Mapping[str, Curve], groups: Mapping[str, str]) -> tuple[Event, ...]:
    """Every event, in order of time.

    Args:
        curves: keyed curves by channel.
        groups: per channel its group: lids, gaze, brows, head, lips or another.

    Returns:
        The events.
    """
    found: list[Event] = []
    for kind, rule in RULES.items():
        single = []
        for name, curve in curves.items():
            plain = name.lower().replace("_", "").replace(" ", "")
            if groups.get(name) == rule.group and any(word in plain for word in rule.words):
                single += list(_single(kind, rule, name, curve))
        found += _merged(single)
    blinks = [(e.start, e.end) for e in found if e.kind == "blink"]
    found = [e for e in found if e.kind != "eye dart" or not _inside(e, blinks)]
    found += _holds({n: c for n, c in curves.items() if not _dense(c)})
    return tuple(sorted(found, key=lambda e: (e.start, e.kind)))


def _inside(event: Event, spans: list[tuple[float, float]]) -> bool:
    """Whether an event happens within one of the spans: eyes that are shut are not seen to move."""
    middle = (event.start + event.end) / 2
    return any(start <= middle <= end for start, end in spans)


def _dense(curve: Curve) -> bool:
    return len(curve.keys) > max(4.0, _DENSE_HZ * (curve.end - curve.start))


def _single(kind: EventKind, rule: _Rule, name: str, curve: Curve) -> Iterator[Event]:
    """Events of one channel."""
    moved = float(np.ptp(curve.value)) if len(curve.keys) > 1 else 0.0
    if moved <= 0.0:
        return
    read = curve
    if _dense(curve):
        rate = (len(curve.keys) - 1) / (curve.end - curve.start)
        read = reduce_curve(
            curve.sample(rate, curve.start, curve.end), rate, "rdp",
            error=_THINNED * moved, start=curve.start,
        )  # fmt: skip
    for first, top, last, height in _runs(read.value / moved, rule.returns):
        start, peak, end = (read.keys[k].time for k in (first, top, last))
        if height < rule.height or end - start > rule.longest:
            continue
        own = _between(curve, start, end)
        if own is not None:
            yield Event(kind, start, peak, end, {name: own}, height)


def _between(curve: Curve, start: float, end: float) -> tuple[int, int] | None:
    """Numbers of the first and the last key between two times."""
    inside = np.flatnonzero((curve.time >= start - 1e-6) & (curve.time <= end + 1e-6))
    return (int(inside[0]), int(inside[-1])) if len(inside) else None


def _runs(value: Array, returns: bool) -> Iterator[tuple[int, int, int, float]]:
    """First, highest and last key of every excursion (or first, last, last of a move), and height.

    Up and down both count. Keys of a plateau belong to it; an excursion's height is over its
    nearer foot.
    """
    level = 0.02  # of what the channel moves: less is a plateau
    steps = np.where(np.abs(np.diff(value)) < level, 0, np.sign(np.diff(value))).astype(int)
    moves: list[tuple[int, int, int]] = []  # first key, last key, direction
    for k, step in enumerate(steps.tolist()):
        if not step:
            continue
        if moves and moves[-1][2] == step and moves[-1][1] == k:
            moves[-1] = (moves[-1][0], k + 1, step)
        else:
            moves.append((k, k + 1, step))
    if not returns:
        for first, last, _ in moves:
            yield first, last, last, abs(float(value[last] - value[first]))
        return
    # Up and back, or down and back; which of them is an excursion tells the usual level.
    usual = float(np.median(value))
    for (first, top, one), (_, last, two) in pairwise(moves):
        away = one * (float(value[top]) - usual) > 0
        if one == -two and away:
            foot = max(one * value[first], one * value[last])
            yield first, top, last, float(one * value[top] - foot)


def _merged(events: list[Event]) -> Iterator[Event]:
    """Events of one kind whose peaks stand close together, as one."""
    waiting = sorted(events, key=lambda e: e.peak)
    while waiting:
        together = [waiting.pop(0)]
        while waiting and waiting[0].peak - together[0].peak <= _TOGETHER:
            together.append(waiting.pop(0))
        highest = max(together, key=lambda e: e.height)
        keys: dict[str, tuple[int, int]] = {}
        for event in together:
            for name, (first, last) in event.keys.items():
                low, high = keys.get(name, (first, last))
                keys[name] = min(low, first), max(high, last)
        start, end = min(e.start for e in together), max(e.end for e in together)
        yield replace(highest, start=start, end=end, keys=keys)


def _holds(curves: Mapping[str, Curve]) -> Iterator[Event]:
    """Times at which no keyed channel moves."""
    moving = [c for c in curves.values() if len(c.keys) > 1 and float(np.ptp(c.value)) > 0]
    if not moving:
        return
    spans: list[tuple[float, float]] = []
    for curve in moving:
        level = 0.02 * float(np.ptp(curve.value))
        flat = np.ptp(curve.controls[:, :, 1], axis=1) < level
        time = curve.time
        spans += [(float(time[k]), float(time[k + 1])) for k in np.flatnonzero(~flat)]
    spans.sort()
    start = min(c.start for c in moving)
    ends = [*spans, (max(c.end for c in moving),) * 2]
    for begin, end in ends:
        if begin - start >= HOLD:
            keys = {n: own for n, c in curves.items() if (own := _between(c, start, begin))}
            yield Event("hold", start, start, begin, keys, 0.0)
        start = max(start, end)


def moved(shot: Shot, event: Event, seconds: float) -> Shot:
    """The shot with one event's keys earlier or later; its neighbours stay where they are.

    Args:
        shot: where the event was found.
        event: one of its events.
        seconds: how much later, negative for earlier.

    Returns:
        The shot; handles beside the event are as long in their spans as they were.

    Raises:
        InputError: the event would run into a key that stays, and how far it may go.
    """
    low, high = room(shot, event)
    if not low <= seconds <= high:
        raise InputError(
            f"{event.kind} at {event.start:.2f} s can be moved by {low:+.3f} to {high:+.3f} s "
            f"before it runs into other keys, not by {seconds:+.3f}."
        )
    curves = dict(shot.curves)
    for name, (first, last) in event.keys.items():
        keys = list(curves[name].keys)
        old = [k.time for k in keys]
        for k in range(first, last + 1):
            keys[k] = keys[k].moved(seconds)
        for left, right in ((first - 1, first), (last, last + 1)):
            if left < 0 or right >= len(keys):
                continue
            scale = (keys[right].time - keys[left].time) / (old[right] - old[left])
            keys[left] = _handle(keys[left], "out_tangent", scale)
            keys[right] = _handle(keys[right], "in_tangent", scale)
        curves[name] = replace(curves[name], keys=tuple(keys))
    return replace(shot, curves=curves)


def room(shot: Shot, event: Event, least: float = 1 / 120) -> tuple[float, float]:
    """How much earlier (negative) and later an event's keys may go.

    Args:
        shot: where the event was found.
        event: one of its events.
        least: seconds between its keys and those that stay.

    Returns:
        Seconds, the first not above and the second not below zero.
    """
    earlier, later = -event.start, np.inf
    for name, (first, last) in event.keys.items():
        time = shot.curves[name].time
        if first > 0:
            earlier = max(earlier, float(time[first - 1] - time[first]) + least)
        if last < len(time) - 1:
            later = min(later, float(time[last + 1] - time[last]) - least)
    return min(earlier, 0.0), max(later, 0.0)


def _handle(key: Key, side: Literal["in_tangent", "out_tangent"], scale: float) -> Key:
    dx, dy = getattr(key, side)
    return replace(key, **{side: (dx * scale, dy)})  # type: ignore[arg-type]
