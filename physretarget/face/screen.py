"""How well every template explains every window of a capture, for one window length at a time.

A template of unit width is laid over the window from its first to its last frame. A span (two
keys) is stretched to the window's end values. A phrase (more keys) takes the least-squares
amplitude within bounds, plus a straight ramp that makes its ends meet the window's: the residual
is what remains after the warp that the output will get, so the measure is of the result itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.face import hmm, sax
from physretarget.face.distance import windows

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Method = Literal["distance", "sax", "hmm"]
METHODS: tuple[Method, ...] = ("distance", "sax", "hmm")


@dataclass(frozen=True, kw_only=True)
class ScreenSettings:
    """Bounds on amplitude (output over library) and the matchers' own parameters.

    word, alphabet: SAX; slope, curvature: weights of the hidden Markov model's features.
    """

    amplitude: tuple[float, float] = (0.2, 5.0)
    word: int = 8
    alphabet: int = 8
    slope: float = 0.25
    curvature: float = 0.05


@dataclass(frozen=True, eq=False)
class Windows:
    """Channels laid end to end (M,), in units of what each moves.

    values: the capture. smooth: the same without noise; windows start and end on it.
    weight: how much a frame counts (1: fully). pace (M, 2): the channel's spread of values over
    its spread of slopes (frames) and of curvatures (frames squared).
    """

    values: Array32
    smooth: Array32
    weight: Array32
    pace: Array32

    @classmethod
    def of(cls, values: Array, smooth: Array, weight: Array) -> Windows:
        """Channels (C, M) end to end, in single precision."""
        spread = smooth.std(axis=1)
        pace = np.empty((*smooth.shape, 2))
        for order in (1, 2):
            steep = np.diff(smooth, n=order, axis=1).std(axis=1) if smooth.shape[1] > 3 else spread
            pace[:, :, order - 1] = (spread / np.maximum(steep, 1e-3 * spread + 1e-9))[:, None]
        flat = [a.astype(np.float32).ravel() for a in (values, smooth, weight)]
        return cls(flat[0], flat[1], flat[2], pace.astype(np.float32).reshape(-1, 2))


@dataclass(frozen=True, eq=False)
class Fit:
    """(R, S) R windows under S templates, per frame.

    squared: weighted squared residual of the values. cost: what the method ranks and pays by.
    """

    squared: Array32
    cost: Array32


def fit_windows(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    method: Method,
    settings: ScreenSettings,
    amplitudes: tuple[Array32, Array32] | None = None,
) -> Fit:
    """Fit shapes (S, n+1) to windows of n+1 frames; amplitudes bounds (S,) mark phrases."""
    ramp = np.linspace(0.0, 1.0, n + 1, dtype=np.float32)
    first, last = capture.smooth[starts], capture.smooth[starts + n]
    rise = (last - first)[:, None]
    level: Array32 = windows(capture.values, n + 1)[starts] - first[:, None]
    weight = windows(capture.weight, n + 1)[starts]
    gain: NDArray[np.float32] = rise
    base = shapes
    if amplitudes is not None:
        base = shapes - shapes[:, -1:] * ramp
        level = (level - rise * ramp).astype(np.float32)
        power = np.maximum(weight @ (base * base).T, 1e-12)
        gain = np.asarray((weight * level) @ base.T / power, np.float32)
        gain = np.clip(gain, amplitudes[0], amplitudes[1])
    squared = _squared(level, base, gain, weight)
    if method == "distance":
        return Fit(squared, squared)
    if method == "sax":
        return Fit(squared, squared + _sax_part(level, base, rise, settings))
    return Fit(
        squared,
        squared
        + _hmm_part(capture, starts, n, base, gain, rise, weight, settings, amplitudes is not None),
    )


def _squared(target: Array32, shapes: Array32, gain: Array32, weight: Array32) -> Array32:
    """(R, S) weighted mean of (target - gain shape) squared."""
    heavy = weight * target
    energy = np.einsum("rn,rn->r", heavy, target)[:, None]
    if gain.shape[1] == 1:  # one matrix product instead of four passes over its result
        left = np.concatenate([heavy * (-2 * gain), weight * gain**2, energy], axis=1)
        one = np.ones((len(shapes), 1), dtype=np.float32)
        total = left @ np.concatenate([shapes, shapes * shapes, one], axis=1).T
    else:
        total = energy - 2 * gain * (heavy @ shapes.T) + gain * gain * (weight @ (shapes**2).T)
    result: Array32 = np.maximum(total, 0.0) / np.float32(target.shape[1])
    return result


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
    distance = sax.mindist(one[first], two, n, settings.alphabet)
    least = distance.min(axis=1, keepdims=True)
    barred = np.where(distance > least + 1e-9, np.float32(1e3), np.float32(0.0))
    per_frame = (least**2 / n).astype(np.float32)
    which = which.ravel()
    part: Array32 = barred[which] + level.var(axis=1)[:, None] * per_frame[which]
    return part


def _hmm_part(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    gain: Array32,
    rise: Array32,
    weight: Array32,
    settings: ScreenSettings,
    phrases: bool,
) -> Array32:
    """Squared emission of slope and curvature under the even alignment.

    With the values' part it bounds the squared Viterbi cost from above: the even alignment is a
    path.
    """
    if n < 3:
        return np.zeros((len(starts), len(shapes)), dtype=np.float32)
    view = windows(capture.smooth, n + 1)[starts]
    total = np.zeros((len(starts), len(shapes)), dtype=np.float32)
    for order, share in ((1, settings.slope), (2, settings.curvature)):
        scale: Array32 = np.float32(share) * capture.pace[starts, order - 1][:, None]
        target = np.diff(view, n=order, axis=1).astype(np.float32)
        if phrases and order == 1:
            target -= rise / n
        model = np.diff(shapes, n=order, axis=1)
        inner = weight[:, order // 2 : n + 1 - (order + 1) // 2]
        total += _squared(target * scale, model, gain * scale, inner)
    return total


def align(example: Array, capture: Array, beta: float = 0.02) -> NDArray[np.intp]:
    """(N,) frames of a capture window (M,) that an example's points (N,) belong to (Viterbi)."""
    cost = hmm.emission(hmm.features(example), hmm.features(capture))
    _, path = hmm.viterbi(cost[None], beta, free_end=False)
    frames: NDArray[np.intp] = path[0]
    return frames
