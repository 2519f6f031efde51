"""How well every template explains every window of a capture, for one window length at a time.

A template of unit width is laid over the window from its first to its last frame. A span (two
keys) is stretched to the window's end values. A phrase (more keys) takes the least-squares
amplitude within bounds, plus a straight ramp that makes its ends meet the window's: the residual
is what remains after the warp that the output will get, so the measure is of the result itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face import sax
from physretarget.face.alignment import Feature, Pairs, Slack, aligned, lower_bound
from physretarget.face.distance import windows
from physretarget.options.facial import Method

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class ScreenSettings:
    """Bounds on amplitude (output over library) and the matchers' own parameters.

    word, alphabet: SAX. slope, curvature: weights of the hidden Markov model's features; haste: its
    price of one frame off the even pace, in units of squared values. beam: windows whose cheapest
    chain is dearer than the cheapest of all by more are not aligned; None: bounds decide, which
    surely gives the placement of aligning everything, in several times the time. wide: paths stray
    from the even pace as far as pays, not by one frame at most; far slower.
    """

    amplitude: tuple[float, float] = (0.2, 5.0)
    word: int = 8
    alphabet: int = 8
    slope: float = 0.25
    curvature: float = 0.05
    haste: float = 2e-3
    beam: float | None = 12.0
    wide: bool = False


@dataclass(frozen=True, eq=False)
class Windows:
    """Channels laid end to end (M,), in units of what each moves.

    values: the capture. smooth: the same without noise; windows start and end on it.
    weight: how much a frame counts (1: fully). slopes (2, M): slope and curvature over the
    channel's own spread of them, times its spread of values. pace (2, M): these factors.
    frames: of one channel.
    """

    values: Array32
    smooth: Array32
    weight: Array32
    slopes: Array32
    pace: Array32
    frames: int

    @classmethod
    def of(cls, values: Array, smooth: Array, weight: Array) -> Windows:
        """Channels (C, M) end to end, in single precision."""
        spread = smooth.std(axis=1)
        slopes, pace = np.zeros((2, 2, *smooth.shape), dtype=np.float32)
        for channel, steep in enumerate(smooth if smooth.shape[1] > 3 else ()):
            for order in range(2):  # one channel at a time: long takes would hold much at once
                steep = np.gradient(steep)
                least = 1e-3 * spread[channel] + 1e-9
                factor = spread[channel] / np.maximum(steep.std(), least)
                pace[order, channel] = factor
                slopes[order, channel] = steep * factor
        flat = [a.astype(np.float32).ravel() for a in (values, smooth, weight)]
        two = [a.reshape(2, -1) for a in (slopes, pace)]
        return cls(flat[0], flat[1], flat[2], two[0], two[1], smooth.shape[1])

    def part(self, low: int, high: int) -> Windows:
        """Frames low to high (open) of every channel, scaled as in the whole."""
        if (low, high) == (0, self.frames):
            return self
        flat = [
            a.reshape(-1, self.frames)[:, low:high].ravel()
            for a in (self.values, self.smooth, self.weight)
        ]
        two = [
            a.reshape(2, -1, self.frames)[:, :, low:high].reshape(2, -1)
            for a in (self.slopes, self.pace)
        ]
        return Windows(flat[0], flat[1], flat[2], two[0], two[1], high - low)


@dataclass(frozen=True, eq=False)
class Laid:
    """Shapes (S, n + 1) laid over windows (R, n + 1): features, weight of frames, rise (R, 1)."""

    features: list[Feature]
    weight: Array32
    rise: Array32
    phrases: bool


def lay(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    method: Method,
    settings: ScreenSettings,
    amplitudes: tuple[Array32, Array32] | None = None,
) -> Laid:
    """Shapes (S, n+1) over windows of n+1 frames; amplitudes bounds (S,) mark phrases."""
    ramp = np.linspace(0.0, 1.0, n + 1, dtype=np.float32)
    first, last = capture.smooth[starts], capture.smooth[starts + n]
    rise = (last - first)[:, None]
    level: Array32 = windows(capture.values, n + 1)[starts] - first[:, None]
    weight = windows(capture.weight, n + 1)[starts]
    gain: Array32 = rise
    base = shapes
    if amplitudes is not None:
        base = shapes - shapes[:, -1:] * ramp
        level = (level - rise * ramp).astype(np.float32)
        power = np.maximum(weight @ (base * base).T, 1e-12)
        gain = np.asarray((weight * level) @ base.T / power, np.float32)
        gain = np.clip(gain, amplitudes[0], amplitudes[1])
    features: list[Feature] = [(level, base, gain)]
    if method == "hmm" and n >= 3:
        tilt = rise if amplitudes is not None else None
        features += _slope_features(capture, starts, n, base, gain, tilt, settings)
    return Laid(features, weight, rise, amplitudes is not None)


def window_costs(laid: Laid, method: Method, settings: ScreenSettings) -> Array32:
    """(R, S) what the method holds against shapes on windows, per frame.

    In units of squared values, whatever the method. The hidden Markov model's is that of the even
    alignment, one path of many; ``aligned_costs`` looks for the cheapest.
    """
    cost = _squared(laid.features, laid.weight)
    if method == "sax":
        level, base, _ = laid.features[0]
        return cost + _sax_part(level, base, laid.rise, settings)
    return cost


def slack_of(capture: Windows, settings: ScreenSettings) -> Slack:
    """How much warping can change the model's features, for bounds from below."""
    shape = (-1, capture.frames)
    shares = np.array([settings.slope, settings.curvature], dtype=np.float32)[:, None]
    own = [capture.values, *(shares * capture.slopes)]
    reach = 2 if settings.wide else 1
    return Slack.of([a.reshape(shape) for a in own], capture.weight.reshape(shape), reach)


def aligned_costs(
    laid: Laid, even: Array32, slack: Array32, limit: Array32, settings: ScreenSettings
) -> Array32:
    """(R, S) as window_costs with every alignment's price, exact where it is below limit (R, S).

    Elsewhere it is what the even one costs. slack (D, R): of these windows.
    """
    m = laid.weight.shape[1]
    if m < 3:
        return even
    room = slack[:, :, None]
    if laid.phrases:  # the ramp that is taken off moves on as well
        strays = np.arange(1, len(slack) + 1, dtype=np.float32)[:, None, None]
        room = room + strays * np.abs(laid.rise) / np.float32(m - 1)
    bound = lower_bound(even, room, settings.haste, m, wide=settings.wide)
    rows, columns = np.nonzero((bound < limit) & (bound < even))
    cost = even.copy()
    if len(rows):
        pairs = Pairs(laid.features, laid.weight, rows, columns)
        found = aligned(pairs, settings.haste, limit[rows, columns], widen=settings.wide)
        cost[rows, columns] = np.minimum(found, even[rows, columns])
    return cost


def _squared(features: list[Feature], weight: Array32) -> Array32:
    """(R, S) sum over features of the weighted mean of (windows - gain shapes) squared.

    Expanded, so that one matrix product does it for all templates where gains are of the window.
    """
    widths = [target.shape[1] for target, _, _ in features]
    if features[0][2].shape[1] > 1:
        total = np.zeros((len(weight), len(features[0][1])), dtype=np.float32)
        for (target, shapes, gain), m in zip(features, widths, strict=True):
            heavy = weight[:, :m] * target
            part = np.einsum("rn,rn->r", heavy, target)[:, None] - 2 * gain * (heavy @ shapes.T)
            total += (part + gain * gain * (weight[:, :m] @ (shapes**2).T)) / np.float32(m)
        return np.maximum(total, 0.0)
    left = np.empty((len(weight), 2 * sum(widths) + 1), dtype=np.float32)
    right = np.ones((len(features[0][1]), left.shape[1]), dtype=np.float32)
    left[:, -1] = 0.0
    at = 0
    for (target, shapes, gain), m in zip(features, widths, strict=True):
        cross, own = slice(at, at + m), slice(at + m, at + 2 * m)
        share = np.float32(1.0 / m)
        np.multiply(weight[:, :m], target, out=left[:, cross])
        left[:, -1] += share * np.einsum("rn,rn->r", left[:, cross], target)
        left[:, cross] *= -2 * share * gain
        np.multiply(weight[:, :m], share * gain**2, out=left[:, own])
        right[:, cross], right[:, own] = shapes, shapes * shapes
        at += 2 * m
    product: Array32 = left @ right.T
    return np.maximum(product, 0.0, out=product)


def _sax_part(level: Array32, shapes: Array32, rise: Array32, settings: ScreenSettings) -> Array32:
    """MINDIST in units of the channel, squared per frame; templates behind the best are barred.

    Ties, which words have many of, are thereby left to the distance.
    """
    n = level.shape[1]
    word = min(settings.word, n)
    sign = np.where(rise < 0, -1.0, 1.0).astype(np.float32)
    spans = shapes[0, -1] > 0.5  # phrases have had their ramp taken off and keep their direction
    one = sax.quick_words(level * sign if spans else level, word, settings.alphabet)
    two = sax.quick_words(shapes, word, settings.alphabet)
    # Windows repeat themselves: distances are needed once per different word.
    code = one.astype(np.int64) @ (settings.alphabet ** np.arange(word, dtype=np.int64))
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    gaps = sax.squared_gaps(one[first], two, settings.alphabet)
    least = gaps.min(axis=1, keepdims=True)
    barred = np.where(gaps > least * (1 + 1e-6) + 1e-9, np.float32(1e3), np.float32(0.0))
    per_frame = (least / np.float32(word)).astype(np.float32)
    which = which.ravel()
    part: Array32 = barred[which] + level.var(axis=1)[:, None] * per_frame[which]
    return part


def _slope_features(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    gain: Array32,
    tilt: Array32 | None,
    settings: ScreenSettings,
) -> list[Feature]:
    """Slope and curvature of windows and shapes, each over the channel's own spread."""
    found: list[Feature] = []
    steep = shapes
    for order, share in enumerate((settings.slope, settings.curvature)):
        steep = _gradient(steep)
        if share == 0:
            continue
        scale: Array32 = np.float32(share) * capture.pace[order, starts][:, None]
        target: Array32 = np.float32(share) * windows(capture.slopes[order], n + 1)[starts]
        if order == 0 and tilt is not None:  # phrases have had their ramp taken off
            target -= tilt / np.float32(n) * scale
        found.append((target, steep, gain * scale))
    return found


def _gradient(rows: Array32) -> Array32:
    """np.gradient along the last axis, without its detours."""
    steep = np.empty_like(rows)
    np.subtract(rows[:, 2:], rows[:, :-2], out=steep[:, 1:-1])
    steep[:, 1:-1] *= np.float32(0.5)
    steep[:, 0] = rows[:, 1] - rows[:, 0]
    steep[:, -1] = rows[:, -1] - rows[:, -2]
    return steep
