"""What Ruhland, Prasad and McDonnell (2017) show, measured here on real captures and real keys.

Their Figure 3 counts keys of 4-second takes at 30 frames a second. The same is counted here, with
what a count alone hides: plain reducers at the same number of keys, timing of turning points,
closeness to an animator's way of keying, and recovery of keys that an animator really set.
The paper's own rig, captures and 1 minute of commissioned animation are not public: the numbers
are of other faces and stand beside the paper's, they do not repeat them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wasserstein_distance

from physretarget.errors import InputError
from physretarget.face.curve import Curve
from physretarget.face.formats import read_take
from physretarget.face.library import Library
from physretarget.face.match import Banks, MatchSettings, Result, match
from physretarget.face.measure import Style, extremum_timing, style
from physretarget.face.recover import Recovery, hold_out, recover
from physretarget.face.reduce import reduce_curve
from physretarget.face.report import REDUCERS
from physretarget.face.rig import Rig
from physretarget.face.screen import METHODS, Method
from physretarget.face.shot import Take

Array = NDArray[np.float64]
PLACEMENTS = ("greedy", "optimal")


@dataclass(frozen=True, kw_only=True)
class ReproduceSettings:
    """takes: 4-second takes per capture file, spread evenly; held_out: shots for recovery."""

    seconds: float = 4.0
    fps: float = 30.0
    takes: int = 3
    held_out: int = 12
    seed: int = 0


@dataclass(frozen=True)
class Row:
    """Means over channels of all takes.

    keys (and their standard deviation), error (root mean square, of what the channel moves),
    timing (frames), spacing and handles (Wasserstein distance to the library's: s, part of span),
    flat and holds (shares of flat tangents and held spans), seconds of computing per take.
    """

    name: str
    placement: str
    keys: float
    spread: float
    error: float
    timing: float
    spacing: float
    handles: float
    flat: float
    holds: float
    seconds: float


@dataclass(frozen=True)
class Reproduction:
    """Everything that the page and results.json tell."""

    inputs: tuple[tuple[str, str], ...]
    takes: int
    channels: int
    frames: int
    library: dict[str, float]
    rows: tuple[Row, ...]
    animator: Row
    recovery: tuple[tuple[str, Recovery], ...]
    held_out: int
    example: tuple[Result, Rig]

    def to_json(self) -> dict[str, Any]:
        """Plain data, without the example take."""
        rows = [asdict(r) for r in self.rows]
        recovery = [{"matcher": name} | asdict(r) for name, r in self.recovery]
        return {
            "schema": "physretarget/ruhland2017/1",
            "inputs": [{"path": p, "sha256": h} for p, h in self.inputs],
            "takes": self.takes,
            "channels_per_take": self.channels,
            "frames_per_take": self.frames,
            "library": self.library,
            "rows": rows,
            "animator": asdict(self.animator),
            "recovery": {"curves_held_out": self.held_out, "rows": recovery},
        }


def reproduce(
    data: Path,
    settings: ReproduceSettings | None = None,
    *,
    progress: Callable[[str], None] = lambda stage: None,
) -> Reproduction:
    """Measure on ``data/face/*.csv`` against a library of ``data/keys``.

    Raises:
        InputError: a folder is missing or holds nothing usable.
    """
    chosen = settings or ReproduceSettings()
    progress("library")
    library = Library.build([_folder(data / "keys")])
    paths = sorted(_folder(data / "face").glob("*.csv"))
    if not paths:
        raise InputError("holds no capture (*.csv).", path=data / "face")
    whole = [read_take(path).resampled(chosen.fps) for path in paths]
    takes = [cut for take in whole for cut in cuts(take, chosen)]
    if not takes:
        raise InputError(f"no capture lasts {chosen.seconds:g} s.", path=data / "face")
    rows, example = _figure_3(takes, library, progress)
    inputs = {(str(p.relative_to(data)), t.sha256) for p, t in zip(paths, whole, strict=True)}
    inputs |= {(f"keys: {e.shot.partition(':')[0]}", e.sha256) for e in library.examples}
    recovery, held = _recovery(library, chosen, progress)
    return Reproduction(
        inputs=tuple(sorted(inputs)),
        takes=len(takes),
        channels=len(example[0].channels),
        frames=len(takes[0].time),
        library={
            "seconds": library.seconds,
            "curves": len(library.examples),
            "keys": sum(len(e.curve.keys) for e in library.examples),
            "segments": len(library.segments),
        },
        rows=tuple(rows),
        animator=_animator(library),
        recovery=tuple(recovery),
        held_out=held,
        example=example,
    )


def _folder(path: Path) -> Path:
    if not path.is_dir():
        raise InputError("there is no such folder; face/*.csv and keys/ are needed.", path=path)
    return path


def cuts(take: Take, settings: ReproduceSettings) -> Iterator[Take]:
    """So many pieces of so many seconds, spread evenly over the take, each starting at 0."""
    frames = round(settings.seconds * settings.fps) + 1
    room = len(take.time) - frames
    if room < 0:
        return
    count = min(settings.takes, room // frames + 1)
    for number, first in enumerate(np.linspace(0, room, count).round().astype(int).tolist()):
        part = slice(first, first + frames)
        time = take.time[part] - take.time[first]
        name = f"{take.name} #{number + 1} from {take.time[first]:.1f} s"
        yield replace(take, name=name, time=time, values=take.values[part])


@dataclass
class _Tally:
    """One list of numbers per measure, one entry per channel and take."""

    keys: list[float]
    error: list[float]
    timing: list[float]
    curves: list[Curve]
    seconds: float = 0.0

    @classmethod
    def empty(cls) -> _Tally:
        return cls([], [], [], [])

    def add(self, curve: Curve, capture: Array, time: Array, unit: float) -> None:
        output = curve.evaluate(time)
        self.keys.append(len(curve.keys))
        self.error.append(float(np.sqrt(np.mean((output - capture) ** 2))) / unit)
        self.timing.append(extremum_timing(output, capture, 0.05 * unit))
        self.curves.append(curve)


def _figure_3(
    takes: list[Take], library: Library, progress: Callable[[str], None]
) -> tuple[list[Row], tuple[Result, Rig]]:
    reference = style([e.curve for e in library.examples])
    tallies: dict[tuple[str, str], _Tally] = {}
    example: tuple[Result, Rig] | None = None
    banks: Banks = {}
    for number, take in enumerate(takes, 1):
        rig = Rig.of(take)
        for placement in PLACEMENTS:
            for method in METHODS:
                progress(f"take {number} of {len(takes)}, {method}, {placement}")
                wanted = MatchSettings(method=method, placement=placement)
                began = clock.perf_counter()
                result = match(take, library, rig, wanted, banks=banks)
                spent = clock.perf_counter() - began
                _count(result, method, placement, spent, tallies)
                if example is None and placement == "optimal":
                    example = result, rig
    assert example is not None
    rows = [
        _row(name, place, tally, reference, len(takes)) for (name, place), tally in tallies.items()
    ]
    return rows, example


def _count(
    result: Result,
    method: Method,
    placement: str,
    seconds: float,
    tallies: dict[tuple[str, str], _Tally],
) -> None:
    """The matcher, and each reducer at the matcher's number of keys, channel by channel."""
    own = tallies.setdefault((method, placement), _Tally.empty())
    own.seconds += seconds
    time = result.take.time
    for name, channel in result.channels.items():
        capture = result.take.channel(name)
        own.add(channel.curve, capture, time, channel.unit)
        for how in REDUCERS:
            plain = tallies.setdefault((f"{how} at {method}'s count", placement), _Tally.empty())
            began = clock.perf_counter()
            curve = reduce_curve(capture, result.take.fps, how, keys=len(channel.curve.keys))
            plain.seconds += clock.perf_counter() - began
            plain.add(curve, capture, time, channel.unit)


def _row(name: str, placement: str, tally: _Tally, reference: Style, takes: int) -> Row:
    found = style(tally.curves)
    return Row(
        name=name,
        placement=placement,
        keys=float(np.mean(tally.keys)),
        spread=float(np.std(tally.keys)),
        error=float(np.mean(tally.error)),
        timing=float(np.nanmean(tally.timing)),
        spacing=float(wasserstein_distance(found.spacing, reference.spacing)),
        handles=float(wasserstein_distance(found.handles, reference.handles)),
        flat=found.flat_share,
        holds=found.hold_share,
        seconds=tally.seconds / takes,
    )


def _animator(library: Library) -> Row:
    """The library's own keying, in the same columns; keys per 4 s of its curves."""
    curves = [e.curve for e in library.examples]
    found = style(curves)
    rates = [4.0 * (len(c.keys) - 1) / (c.end - c.start) for c in curves]
    return Row(
        "the library's animators", "", float(np.mean(rates)), float(np.std(rates)), 0.0, 0.0, 0.0,
        0.0, found.flat_share, found.hold_share, 0.0,
    )  # fmt: skip


def _recovery(
    library: Library, settings: ReproduceSettings, progress: Callable[[str], None]
) -> tuple[list[tuple[str, Recovery]], int]:
    """Keys that an unseen animator's curve had, per matcher and for reducers at its key count."""
    shots = sorted({e.shot for e in library.examples})
    rng = np.random.default_rng(settings.seed)
    picked = rng.choice(len(shots), min(settings.held_out, len(shots) // 2), replace=False)
    rest, asked = hold_out(library, [shots[int(k)] for k in np.sort(picked)])
    rows: list[tuple[str, Recovery]] = []
    if not asked:
        return rows, 0
    for method in METHODS:
        progress(f"recovery of {len(asked)} held-out curves, {method}")
        found = recover(rest, asked, MatchSettings(method=method), seed=settings.seed)
        rows += [(method, one) for one in found]
    return rows, len(asked)
