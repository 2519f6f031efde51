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


_Feature = tuple[Array32, Array32, Array32]
"""Windows (R, m), shapes (S, m) and gains (R, 1) or (R, S): what (windows - gain shapes) is of."""


def window_costs(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    method: Method,
    settings: ScreenSettings,
    amplitudes: tuple[Array32, Array32] | None = None,
) -> Array32:
    """(R, S) what the method holds against shapes (S, n+1) on windows of n+1 frames, per frame.

    In units of squared values, whatever the method; amplitudes bounds (S,) mark phrases.
    """
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
    features: list[_Feature] = [(level, base, gain)]
    if method == "hmm" and n >= 3:
        tilt = rise if amplitudes is not None else np.zeros_like(rise)
        features += _hmm_features(capture, starts, n, base, gain, tilt, settings)
    cost = _squared(features, weight)
    return cost + _sax_part(level, base, rise, settings) if method == "sax" else cost


def _squared(features: list[_Feature], weight: Array32) -> Array32:
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
    distance = sax.mindist(one[first], two, n, settings.alphabet)
    least = distance.min(axis=1, keepdims=True)
    barred = np.where(distance > least + 1e-9, np.float32(1e3), np.float32(0.0))
    per_frame = (least**2 / n).astype(np.float32)
    which = which.ravel()
    part: Array32 = barred[which] + level.var(axis=1)[:, None] * per_frame[which]
    return part


def _hmm_features(
    capture: Windows,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    gain: Array32,
    tilt: Array32,
    settings: ScreenSettings,
) -> list[_Feature]:
    """Slope and curvature of windows and shapes, each over the channel's own spread.

    With the values these are the squared emissions of the even alignment, which bound the squared
    Viterbi cost from above: the even alignment is a path.
    """
    found: list[_Feature] = []
    for order, share in ((1, settings.slope), (2, settings.curvature)):
        if share == 0:
            continue
        scale: Array32 = np.float32(share) * capture.pace[starts, order - 1][:, None]
        steep = np.diff(capture.smooth, n=order)
        target = windows(steep, n + 1 - order)[starts]
        if order == 1:
            target -= tilt / n  # a copy: phrases have had their ramp taken off
        target *= scale
        found.append((target, np.diff(shapes, n=order, axis=1), gain * scale))
    return found


def align(example: Array, capture: Array, beta: float = 0.02) -> NDArray[np.intp]:
    """(N,) frames of a capture window (M,) that an example's points (N,) belong to (Viterbi)."""
    cost = hmm.emission(hmm.features(example), hmm.features(capture))
    _, path = hmm.viterbi(cost[None], beta, free_end=False)
    frames: NDArray[np.intp] = path[0]
    return frames
