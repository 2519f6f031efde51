"""The strongest test that needs no pairing: are an unseen animator's keys found again?

Files are held out of the library, with every copy of their curves in other files. A whole file
becomes one pseudo-capture (noise, and one time jitter a frame for all its channels), is matched,
and compared with the keys that the animator set, side by side with plain reducers at the same
number of keys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve
from physretarget.face.library import Example, Library
from physretarget.face.match import Banks, ChannelResult, MatchSettings, match
from physretarget.face.measure import Style, distances, key_f1, pseudo_take, style
from physretarget.face.reduce import REDUCERS, reduce_curve
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.shot import Take

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recovery:
    """Means over curves: F1 of keys, error to the clean curve (of its range), keys per curve.

    spacing, handles, slopes: Wasserstein distance to the held-out curves' own key spacing (s),
    tangent lengths (part of the span) and slopes (of a straight line through the span); holds:
    share of held spans less the animators' share. doubtful: share of flagged pieces, and how many
    of these and of the others begin and end on a key of the animator's; none for reducers.
    by_file: per held-out file the sum of its curves' F1, and how many there are.
    """

    name: str
    curves: int
    f1: float
    precision: float
    recall: float
    error: float
    keys: float
    spacing: float
    handles: float
    slopes: float
    holds: float
    doubtful: float | None = None
    right_if_doubtful: float | None = None
    right_if_sure: float | None = None
    by_file: tuple[tuple[float, int], ...] = ()


def difference(one: Recovery, other: Recovery) -> tuple[float, float, float]:
    """By how much one way finds more than another on the same curves, and its 95 % interval.

    The interval is over files, by 4000 bootstrap samples of them: curves of one file are no
    independent witnesses.

    Args:
        one: a way.
        other: another way, asked the same.

    Returns:
        Difference of the mean F1, and the interval's ends.
    """
    gains = np.array([a[0] - b[0] for a, b in zip(one.by_file, other.by_file, strict=True)])
    curves = np.array([n for _, n in one.by_file], dtype=np.float64)
    picks = np.random.default_rng(0).integers(0, len(gains), (4000, len(gains)))
    means = gains[picks].sum(axis=1) / curves[picks].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(gains.sum() / curves.sum()), float(low), float(high)


def test_files(names: Sequence[str]) -> tuple[str, ...]:
    """The part that parameters were never tuned on: every third name in order, from the third."""
    return tuple(sorted(set(names))[2::3])


def signature(example: Example) -> tuple[object, ...]:
    """The same for copies of a curve: key times (to 1/60 s) and normalised values."""
    table = example.curve.table
    times = np.round((table[:, 0] - table[0, 0]) * 60).astype(int)
    extent = max(float(np.ptp(table[:, 1])), 1e-9)
    values = np.round((table[:, 1] - table[0, 1]) / extent, 2) + 0.0
    return (tuple(times.tolist()), tuple(values.tolist()))


def hold_out(
    library: Library, shots: Sequence[str], *, least_keys: int = 4, least_seconds: float = 0.5
) -> tuple[Library, tuple[Example, ...]]:
    """The library without these shots and without copies of their curves; and those curves, once.

    Curves with held (stepped) keys, too few keys or too short are not asked for.
    """
    outside = set(shots)
    taboo = {signature(e) for e in library.examples if e.shot in outside}
    rest = library.without(lambda e: e.shot in outside or signature(e) in taboo)
    asked: dict[tuple[object, ...], Example] = {}
    for example in library.examples:
        keys = example.curve.keys
        smooth = not any(k.out_type.startswith("stepped") for k in keys[:-1])
        long = example.curve.end - example.curve.start >= least_seconds
        if example.shot in outside and len(keys) >= least_keys and smooth and long:
            asked.setdefault(signature(example), example)
    return rest, tuple(asked.values())


@dataclass
class _Scores:
    rows: list[list[float]] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)  # curves of each file
    curves: list[Curve] = field(default_factory=list)
    pieces: list[tuple[bool, bool]] = field(default_factory=list)  # doubtful, right


def recover(
    library: Library,
    examples: Sequence[Example],
    settings: MatchSettings,
    *,
    fps: float = 60.0,
    noise: float = 0.01,
    jitter: float = 1.0,
    smooth: float = 0.0,
    tolerance: float = 1.0,
    seed: int = 0,
) -> tuple[Recovery, ...]:
    """The matcher, and plain reducers at the matcher's number of keys, curve by curve.

    smooth: standard deviation, in frames, of a Gaussian that the capture has been through.
    """
    banks = Banks()
    scores = {name: _Scores() for name in ("match", *REDUCERS)}
    for number, members in enumerate(files(examples)):
        rng = np.random.default_rng([seed, number])
        curves = [e.curve for e in members]
        clean, noisy, start = pseudo_take(
            curves, fps, rng, noise=noise, jitter=jitter, smooth=smooth
        )
        names = tuple(f"c{k}" for k in range(len(members)))
        time = np.arange(noisy.shape[1]) / fps
        take = Take("held out", time, names, noisy.T)
        channels = tuple(
            RigChannel(name, "other", float(v.min()), float(v.max()) + 1e-12, {name: 1.0})
            for name, v in zip(names, noisy, strict=True)
        )
        result = match(take, library, Rig("held out", channels), settings, banks=banks)
        for score in scores.values():
            score.sizes.append(len(members))
        for name, curve, one, rough in zip(names, curves, clean, noisy, strict=True):
            true = (curve.time - start) * fps
            found = result.channels[name]
            count = len(found.curve.keys)
            outputs = [found.curve]
            outputs += [reduce_curve(rough, fps, how, keys=count) for how in REDUCERS]
            for score, output in zip(scores.values(), outputs, strict=True):
                score.rows.append(_scores(output, true, one, time, fps, tolerance))
                score.curves.append(output)
            scores["match"].pieces += _right(found, true / fps, tolerance / fps)
    reference = style([e.curve for e in examples])
    return tuple(_mean(name, score, reference) for name, score in scores.items())


def files(examples: Sequence[Example]) -> list[list[Example]]:
    """Examples by the file that they come from: what was drawn together is one take."""
    found: dict[str, list[Example]] = {}
    for example in examples:
        found.setdefault(example.sha256 or example.shot, []).append(example)
    return list(found.values())


def _right(found: ChannelResult, true: Array, tolerance: float) -> list[tuple[bool, bool]]:
    """Per piece whether it is flagged, and whether both its ends are keys of the animator's."""

    def near(time: float) -> bool:
        return bool(np.abs(true - time).min() <= tolerance + 1e-9)

    return [(p.doubtful, near(p.start) and near(p.end)) for p in found.pieces]


def _scores(
    curve: Curve, true: Array, clean: Array, time: Array, fps: float, tolerance: float
) -> list[float]:
    f1, precision, recall = key_f1(curve.time * fps, true, tolerance)
    deviation = float(np.sqrt(np.mean((curve.evaluate(time) - clean) ** 2)))
    return [f1, precision, recall, deviation / max(float(np.ptp(clean)), 1e-12), len(curve.keys)]


def _mean(name: str, score: _Scores, reference: Style) -> Recovery:
    table = np.array(score.rows) if score.rows else np.full((1, 5), np.nan)
    found = style(score.curves)
    flags = np.array(score.pieces, dtype=bool).reshape(-1, 2)
    doubtful, right = flags[:, 0], flags[:, 1]
    f1, precision, recall, error, keys = (float(v) for v in table.mean(axis=0))
    return Recovery(
        name,
        len(score.rows),
        f1,
        precision,
        recall,
        error,
        keys,
        *distances(found, reference),
        found.hold_share - reference.hold_share,
        float(doubtful.mean()) if len(flags) else None,
        float(right[doubtful].mean()) if doubtful.any() else None,
        float(right[~doubtful].mean()) if (~doubtful).any() else None,
        tuple(
            (float(table[end - size : end, 0].sum()), size)
            for end, size in zip(np.cumsum(score.sizes).tolist(), score.sizes, strict=True)
        ),
    )
