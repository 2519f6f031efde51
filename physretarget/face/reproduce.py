"""What Ruhland, Prasad and McDonnell (2017) show, measured here on real captures and real keys.

Their Figure 3 counts keys of 4-second takes at 30 frames a second. The same is counted here, with
what a count alone hides: plain reducers at the same number of keys, timing of turning points,
closeness to an animator's way of keying, and recovery of keys that an animator really set.
The paper's own rig, captures and 1 minute of commissioned animation are not public: the numbers
are of other faces and stand beside the paper's, they do not repeat them.
Every step's numbers are kept beside the page, so that a run that was cut short goes on.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Curve
from physretarget.face.formats import read_take
from physretarget.face.library import Example, Library
from physretarget.face.match import Banks, MatchSettings, Result, match
from physretarget.face.measure import Style, distances, style, turning_point_timing
from physretarget.face.parts import Parts
from physretarget.face.recover import Recovery, difference, hold_out, recover, test_files
from physretarget.face.reduce import REDUCERS, reduce_curve
from physretarget.face.rig import Rig
from physretarget.face.shot import Take

Array = NDArray[np.float64]
WAYS: dict[str, dict[str, Any]] = {
    "default": {},
    "ruhland2017 distance": {"preset": "ruhland2017", "method": "distance"},
    "ruhland2017 sax": {"preset": "ruhland2017", "method": "sax"},
    "ruhland2017 hmm": {"preset": "ruhland2017", "method": "hmm"},
}
"""The default and the paper as written, with each of its three matchers."""
ALONE: dict[str, Any] = {"learned": False}
"""The control: the same programme, with nothing learned from the library."""
RATES = (60.0, 30.0, 24.0)
VARIANTS: dict[str, dict[str, Any]] = {
    "1 % noise": {},
    "3 % noise": {"noise": 0.03},
    "1 % noise, smoothed": {"smooth": 1.0},
}
"""What the default is asked, each on held-out curves at 30 Hz."""


@dataclass(frozen=True, kw_only=True)
class ReproduceSettings:
    """takes: 4-second takes per capture file, spread evenly.

    curves: most curves asked for per collection; variants: curves for each variant.
    """

    seconds: float = 4.0
    fps: float = 30.0
    takes: int = 2
    curves: int = 200
    variants: int = 40
    seed: int = 0


@dataclass(frozen=True)
class Row:
    """Means over channels of all takes.

    keys (and their standard deviation), error (root mean square, of what the channel moves),
    timing (frames, of the turning points found), missed (share of those not found), spacing (s),
    handles (part of span), slopes: Wasserstein distances to the library's; flat and holds: shares
    of flat tangents and held spans; seconds of computing per take.
    """

    name: str
    keys: float
    spread: float
    error: float
    timing: float
    missed: float
    spacing: float
    handles: float
    slopes: float
    flat: float
    holds: float
    seconds: float


@dataclass(frozen=True)
class Asked:
    """One measurement on held-out curves: collection, frames a second, what was varied, rows."""

    collection: str
    fps: float
    variant: str
    rows: tuple[Recovery, ...]


@dataclass(frozen=True)
class Reproduction:
    """Everything that the page and ruhland2017.json tell."""

    inputs: tuple[tuple[str, str], ...]
    takes: int
    channels: int
    frames: int
    library: dict[str, float]
    rows: tuple[Row, ...]
    animator: Row
    recovery: tuple[Asked, ...]
    variants: tuple[Asked, ...]
    controls: tuple[Asked, ...]
    tested: tuple[str, ...]
    example: tuple[Result, Rig, Library]

    def library_gain(self) -> list[tuple[str, float, float, float, float]]:
        """Collection, frames a second, F1 of the default over its control, and the interval."""
        asked = {(a.collection, a.fps): a for a in self.recovery if a.variant == "default"}
        return [
            (c.collection, c.fps, *difference(asked[c.collection, c.fps].rows[0], c.rows[0]))
            for c in self.controls
        ]

    def to_json(self) -> dict[str, Any]:
        """Plain data, without the example take."""
        return {
            "schema": "physretarget/ruhland2017/4",
            "inputs": [{"path": p, "sha256": h} for p, h in self.inputs],
            "takes": self.takes,
            "channels_per_take": self.channels,
            "frames_per_take": self.frames,
            "library": self.library,
            "rows": [asdict(r) for r in self.rows],
            "animator": asdict(self.animator),
            "tested": list(self.tested),
            "recovery": [asdict(r) for r in self.recovery],
            "controls": [asdict(r) for r in self.controls],
            "library_over_programme": [
                dict(zip(("collection", "fps", "f1", "low", "high"), row, strict=True))
                for row in self.library_gain()
            ],
            "variants": [asdict(r) for r in self.variants],
        }


def reproduce(
    data: Path,
    settings: ReproduceSettings | None = None,
    *,
    parts: Path | None = None,
    progress: Callable[[str], None] = lambda stage: None,
) -> Reproduction:
    """Measure on ``data/face/*.csv`` against a library of ``data/keys``.

    parts: a folder that keeps every finished step; a later run of the same takes it from there.

    Raises:
        InputError: a folder is missing or holds nothing usable.
    """
    chosen = settings or ReproduceSettings()
    progress("library")
    folder = _folder(data / "keys")
    collections = [p for p in sorted(folder.iterdir()) if p.is_dir()] or [folder]
    libraries = {path.name: Library.build([path]) for path in collections}
    library = Library(tuple(e for one in libraries.values() for e in one.examples))
    paths = sorted(_folder(data / "face").glob("*.csv"))
    if not paths:
        raise InputError("holds no capture (*.csv).", path=data / "face")
    whole = [read_take(path).resampled(chosen.fps) for path in paths]
    takes = [cut for take in whole for cut in cuts(take, chosen)]
    if not takes:
        raise InputError(f"no capture lasts {chosen.seconds:g} s.", path=data / "face")
    inputs = {(str(p.relative_to(data)), t.sha256) for p, t in zip(paths, whole, strict=True)}
    inputs |= {(f"keys: {e.shot.partition(':')[0]}", e.sha256) for e in library.examples}
    kept = Parts(parts, [sorted(inputs), asdict(chosen)], progress)
    rows = _figure_3(takes, library, kept)
    recovery, variants, controls, tested = _recovery(libraries, chosen, kept)
    progress("example take")
    rig = Rig.of(takes[0])
    example = match(takes[0], library, rig)
    return Reproduction(
        inputs=tuple(sorted(inputs)),
        takes=len(takes),
        channels=len(example.channels),
        frames=len(takes[0].time),
        library={
            "seconds": library.seconds,
            "curves": len(library.examples),
            "keys": sum(len(e.curve.keys) for e in library.examples),
            "segments": len(library.segments),
        },
        rows=tuple(rows),
        animator=_animator(library),
        recovery=recovery,
        variants=variants,
        controls=controls,
        tested=tested,
        example=(example, rig, library),
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


def _figure_3(takes: list[Take], library: Library, kept: Parts) -> list[Row]:
    reference = style([e.curve for e in library.examples])
    banks = Banks()
    tallies: dict[str, list[dict[str, Any]]] = {}
    for number, take in enumerate(takes, 1):
        for way, options in WAYS.items():
            wanted = MatchSettings(**options)
            found = kept.get(
                f"take {number} of {len(takes)}, {way}",
                lambda t=take, n=way, w=wanted: _count(t, library, n, w, banks),  # type: ignore[misc]
            )
            for name, tally in found.items():
                tallies.setdefault(name, []).append(tally)
    return [_row(name, parts, reference) for name, parts in tallies.items()]


def _count(
    take: Take, library: Library, way: str, settings: MatchSettings, banks: Banks
) -> dict[str, dict[str, Any]]:
    """The matcher, and each reducer at the matcher's number of keys, channel by channel."""
    began = clock.process_time()
    result = match(take, library, Rig.of(take), settings, banks=banks)
    spent: dict[str, float] = {way: clock.process_time() - began}
    curves: dict[str, dict[str, Curve]] = {way: {n: c.curve for n, c in result.channels.items()}}
    for how in REDUCERS:
        began = clock.process_time()
        label = f"{how} at {way}'s count"
        curves[label] = {
            name: reduce_curve(take.channel(name), take.fps, how, keys=len(c.curve.keys))
            for name, c in result.channels.items()
        }
        spent[label] = clock.process_time() - began
    found: dict[str, dict[str, Any]] = {}
    for label, made in curves.items():
        errors, timings = [], []
        for name, curve in made.items():
            capture, unit = take.channel(name), result.channels[name].unit
            output = curve.evaluate(take.time)
            errors.append(float(np.sqrt(np.mean((output - capture) ** 2))) / unit)
            timing = turning_point_timing(output, capture, 0.1 * unit)
            hits = round(timing.count * (1.0 - timing.missed))
            timings.append([timing.frames * hits if hits else 0.0, hits, timing.count])
        keyed = style(list(made.values()))
        found[label] = {
            "keys": [len(c.keys) for c in made.values()],
            "error": errors,
            "timing": timings,
            "seconds": spent[label],
            "style": {k: np.asarray(v).tolist() for k, v in asdict(keyed).items()},
        }
    return found


def _row(name: str, parts: list[dict[str, Any]], reference: Style) -> Row:
    keys = [k for p in parts for k in p["keys"]]
    off, hits, count = np.array([t for p in parts for t in p["timing"]]).sum(axis=0)

    def joined(what: str) -> Array:
        return np.concatenate([p["style"][what] for p in parts])

    def mean(what: str) -> float:
        weight = [len(p["style"]["spacing"]) for p in parts]
        return float(np.average([p["style"][what] for p in parts], weights=weight))

    keyed = Style(joined("spacing"), joined("handles"), joined("slopes"), 0.0, 0.0)
    return Row(
        name,
        float(np.mean(keys)),
        float(np.std(keys)),
        float(np.mean([e for p in parts for e in p["error"]])),
        float(off / hits) if hits else 0.0,
        float(1.0 - hits / count) if count else 0.0,
        *distances(keyed, reference),
        mean("flat_share"),
        mean("hold_share"),
        float(np.mean([p["seconds"] for p in parts])),
    )


def _animator(library: Library) -> Row:
    """The library's own keying, in the same columns; keys per 4 s of its curves."""
    curves = [e.curve for e in library.examples]
    found = style(curves)
    rates = [4.0 * (len(c.keys) - 1) / (c.end - c.start) for c in curves]
    return Row(
        "the library's animators", float(np.mean(rates)), float(np.std(rates)), 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, found.flat_share, found.hold_share, 0.0,
    )  # fmt: skip


def _recovery(
    libraries: dict[str, Library], settings: ReproduceSettings, kept: Parts
) -> tuple[tuple[Asked, ...], tuple[Asked, ...], tuple[Asked, ...], tuple[str, ...]]:
    """Keys that unseen curves had.

    Of the first collection with enough files the test files are asked, against the rest of it; of
    every other collection all files, against the same library: another animator's hand.
    """
    names = {
        k: sorted({e.shot.partition(":")[0] for e in v.examples}) for k, v in libraries.items()
    }
    main = max(libraries, key=lambda k: len(names[k]))
    tested = test_files([e.shot for e in libraries[main].examples])
    rest, asked = hold_out(libraries[main], tested)
    questions: list[tuple[str, Library, tuple[Example, ...]]] = [(main, rest, asked)]
    for name, other in libraries.items():
        if name != main:
            both = Library(rest.examples + other.examples)
            questions.append((name, *hold_out(both, sorted({e.shot for e in other.examples}))))
    recovery = [
        _ask(kept, name, known, _some(wanted, settings.curves), fps, way, options)
        for name, known, wanted in questions
        if wanted
        for fps in RATES
        for way, options in WAYS.items()
    ]
    few = _some(asked, settings.variants)
    variants = [
        _ask(kept, main, rest, few, 30.0, variant, {}, **changes)
        for variant, changes in VARIANTS.items()
        if few
    ]
    controls = [
        _ask(kept, name, known, _some(wanted, settings.curves), fps, "programme alone", ALONE)
        for name, known, wanted in questions
        if wanted
        for fps in RATES
    ]
    return tuple(recovery), tuple(variants), tuple(controls), tested


def _some(examples: tuple[Example, ...], most: int) -> tuple[Example, ...]:
    """At most so many, spread evenly."""
    if len(examples) <= most:
        return examples
    return tuple(examples[k] for k in np.linspace(0, len(examples) - 1, most).astype(int))


def _ask(
    kept: Parts,
    name: str,
    library: Library,
    examples: tuple[Example, ...],
    fps: float,
    variant: str,
    options: dict[str, Any],
    noise: float = 0.01,
    smooth: float = 0.0,
) -> Asked:
    rows = kept.get(
        f"{len(examples)} held-out curves of {name} at {fps:g} Hz: {variant}",
        lambda: [
            asdict(row)
            for row in recover(
                library, examples, MatchSettings(**options), fps=fps, noise=noise, smooth=smooth
            )
        ],
    )
    return Asked(name, fps, variant, tuple(Recovery(**row) for row in rows))
