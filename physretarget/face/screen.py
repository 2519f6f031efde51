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
    slope: float = 0.5
    curvature: float = 0.25


@dataclass(frozen=True, eq=False)
class Fit:
    """(R, S) mean squared residual of R windows under S templates, and the amplitudes taken.

    squared: residual of the values; score: what the method ranks by (the same for distance).
    """

    squared: Array32
    score: Array32
    gain: Array32


def fit_windows(
    capture: Array32,
    smooth: Array32,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    method: Method,
    settings: ScreenSettings,
    amplitudes: tuple[Array32, Array32] | None = None,
) -> Fit:
    """Fit shapes (S, n+1) to windows of n+1 frames; amplitudes bounds (S,) mark phrases.

    capture (M,) in units of the channel's range, smooth (M,) the same without noise: windows
    start and end on the smooth values, the residual is taken against the capture.
    """
    ramp = np.linspace(0.0, 1.0, n + 1, dtype=np.float32)
    first, last = smooth[starts], smooth[starts + n]
    rise = last - first
    level: Array32 = windows(capture, n + 1)[starts] - first[:, None]
    gain: NDArray[np.float32]
    if amplitudes is None:
        gain = np.broadcast_to(rise[:, None], (len(starts), len(shapes)))
        cross = level @ shapes.T
        energy = np.einsum("rn,rn->r", level, level)[:, None]
        residual = energy - 2 * rise[:, None] * cross
        residual += rise[:, None] ** 2 * np.einsum("sn,sn->s", shapes, shapes)[None]
    else:
        bent = shapes - shapes[:, -1:] * ramp
        level = (level - rise[:, None] * ramp).astype(np.float32)
        power = np.maximum(np.einsum("sn,sn->s", bent, bent), 1e-12)[None]
        cross = level @ bent.T
        gain = np.asarray(np.clip(cross / power, amplitudes[0], amplitudes[1]), np.float32)
        energy = np.einsum("rn,rn->r", level, level)[:, None]
        residual = energy - 2 * gain * cross + gain * gain * power
    squared = np.maximum(residual, 0.0) / np.float32(n + 1)
    if method == "distance":
        score = squared
    elif method == "sax":
        score = _sax_score(level, shapes if amplitudes is None else bent, rise, squared, settings)
    else:
        score = _hmm_score(
            smooth, starts, n, shapes, gain, rise, squared, settings, amplitudes is not None
        )
    return Fit(squared, score, gain)


def _sax_score(
    level: Array32, shapes: Array32, rise: Array32, squared: Array32, settings: ScreenSettings
) -> Array32:
    """Distance where the words are as alike as any template's; elsewhere far behind."""
    n = level.shape[1]
    word = min(settings.word, n)
    sign = np.where(rise < 0, -1.0, 1.0).astype(np.float32)[:, None]
    spans = shapes[0, -1] > 0.5  # phrases have had their ramp taken off and keep their direction
    one = sax.quick_words(level * sign if spans else level, word, settings.alphabet)
    two = sax.quick_words(shapes, word, settings.alphabet)
    # Windows repeat themselves: distances are needed once per different word.
    code = one.astype(np.int64) @ (settings.alphabet ** np.arange(word, dtype=np.int64))
    _, first, which = np.unique(code, return_index=True, return_inverse=True)
    distance = sax.mindist(one[first], two, n, settings.alphabet)
    behind = distance > distance.min(axis=1, keepdims=True) + 1e-9
    penalty = np.where(behind, np.float32(1e3), np.float32(0.0))
    score: Array32 = squared + penalty[which.ravel()]
    return score


def _hmm_score(
    smooth: Array32,
    starts: NDArray[np.intp],
    n: int,
    shapes: Array32,
    gain: Array32,
    rise: Array32,
    squared: Array32,
    settings: ScreenSettings,
    phrases: bool,
) -> Array32:
    """Squared emission of the even alignment: value, slope and curvature of the fitted shape.

    It bounds the squared Viterbi cost from above, since the even alignment is a path.
    """
    if n < 3:
        return squared
    ramp = np.linspace(0.0, 1.0, n + 1, dtype=np.float32)
    view = windows(smooth, n + 1)[starts]
    base = shapes - shapes[:, -1:] * ramp if phrases else shapes
    total = squared.copy()
    for order, weight in ((1, settings.slope / 1.5), (2, settings.curvature / 6.0)):
        scale = np.float32(weight * float(n) ** order)
        target = np.diff(view, n=order, axis=1) * scale
        if phrases and order == 1:
            target = target - (rise / n * scale)[:, None]
        model = np.diff(base, n=order, axis=1) * scale
        power = np.einsum("rn,rn->r", target, target)[:, None]
        own = np.einsum("sn,sn->s", model, model)[None]
        part = power - 2 * gain * (target @ model.T) + gain * gain * own
        total += np.maximum(part, 0.0) / np.float32(n + 1 - order)
    return total


def align(example: Array, capture: Array, beta: float = 0.02) -> NDArray[np.intp]:
    """(N,) frames of a capture window (M,) that an example's points (N,) belong to (Viterbi)."""
    cost = hmm.emission(hmm.features(example), hmm.features(capture))
    _, path = hmm.viterbi(cost[None], beta, free_end=False)
    frames: NDArray[np.intp] = path[0]
    return frames
