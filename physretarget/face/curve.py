"""An animator's curve: keys with tangents, evaluated exactly.

A span between two keys is a cubic Bézier in the (time, value) plane. Its inner control points
are the keys plus their tangents, which are offsets ``(dx, dy)`` in seconds and channel units: the
out tangent points right (dx >= 0), the in tangent left (dx <= 0). Where two tangents are so long
that time would run backward, each is shortened to its span, direction kept.
Before the first key and after the last the curve holds its value.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from physretarget.errors import InputError
from physretarget.face.bezier import auto_slopes, bezier, solve_time, spline_slopes

Array = NDArray[np.float64]
TangentType = Literal["auto", "spline", "linear", "flat", "stepped", "stepped_next", "fixed"]
TANGENT_TYPES: tuple[TangentType, ...] = get_args(TangentType)
"""auto: flat at extrema, else monotone; spline: through the neighbours; stepped: hold this key's
value up to the next key; stepped_next: jump at once to the next key's; fixed: as given."""
_COMPUTED = ("auto", "spline", "linear", "flat")


@dataclass(frozen=True)
class Key:
    """One key: time (s), value, tangents as offsets (s, value) and how they came about.

    ``broken`` tangents (free, in Maya's words) may point in different directions.
    """

    time: float
    value: float
    in_tangent: tuple[float, float] = (0.0, 0.0)
    out_tangent: tuple[float, float] = (0.0, 0.0)
    in_type: TangentType = "fixed"
    out_type: TangentType = "fixed"
    broken: bool = False

    def moved(self, time: float = 0.0, value: float = 0.0) -> Key:
        """The same key shifted in time and value.

        Args:
            time: Added to the time, s.
            value: Added to the value.

        Returns:
            The moved key.
        """
        return replace(self, time=self.time + time, value=self.value + value)

    def scaled_to(self, time: float, value: float) -> Key:
        """The same key with time and value, tangents included, multiplied.

        Args:
            time: Factor of the time.
            value: Factor of the value.

        Returns:
            The scaled key.
        """
        (a, b), (c, d) = self.in_tangent, self.out_tangent
        return replace(
            self,
            time=self.time * time,
            value=self.value * value,
            in_tangent=(a * time, b * value),
            out_tangent=(c * time, d * value),
        )


@dataclass(frozen=True)
class Curve:
    """Keys in order of time; no keys is an InputError, one key is a constant.

    ``weighted`` tangents have free lengths; the others are a third of the span in time.
    """

    keys: tuple[Key, ...]
    weighted: bool = True

    def __post_init__(self) -> None:
        if not self.keys:
            raise InputError("a curve needs at least one key.")
        for number, key in enumerate(self.keys):
            _check_key(number, key)
        for number, (left, right) in enumerate(zip(self.keys, self.keys[1:], strict=False), 1):
            if right.time <= left.time:
                what = "the same time as" if right.time == left.time else "an earlier time than"
                raise InputError(
                    f"key {number} (t = {right.time:g} s) has {what} key {number - 1} "
                    f"(t = {left.time:g} s); times must increase."
                )

    @classmethod
    def through(
        cls, time: ArrayLike, value: ArrayLike, tangents: TangentType = "auto", **options: bool
    ) -> Curve:
        """A curve through points, its tangents computed as the type says.

        Args:
            time: (N,) s, increasing.
            value: (N,) values, in the channel's unit.
            tangents: Kind of all tangents.
            options: Flags of every key.

        Returns:
            The curve.
        """
        times, values = np.asarray(time, float), np.asarray(value, float)
        if times.ndim != 1 or times.shape != values.shape:
            raise InputError(f"times {times.shape} and values {values.shape} must be equal lists.")
        pairs = zip(times.tolist(), values.tolist(), strict=True)
        keys = tuple(Key(t, v, in_type=tangents, out_type=tangents) for t, v in pairs)
        return cls(keys, **options).retangented()

    @classmethod
    def from_table(
        cls,
        table: ArrayLike,
        types: Iterable[tuple[TangentType, TangentType, bool]] | None = None,
        weighted: bool = True,
    ) -> Curve:
        """A curve from rows like those of ``table``.

        Args:
            table: (N, 6) rows as in ``table``.
            types: Kinds of the tangents of every key, in and out, and whether it is broken.
            weighted: Whether handles have lengths of their own.

        Returns:
            The curve.
        """
        rows = np.asarray(table, float).tolist()
        fixed: tuple[TangentType, TangentType, bool] = ("fixed", "fixed", False)
        kinds = list(types) if types is not None else [fixed] * len(rows)
        keys = tuple(
            Key(t, v, (a, b), (c, d), kind[0], kind[1], kind[2])
            for (t, v, a, b, c, d), kind in zip(rows, kinds, strict=True)
        )
        return cls(keys, weighted)

    @cached_property
    def table(self) -> Array:
        """(K, 6): time, value, in dx, in dy, out dx, out dy."""
        rows = [(k.time, k.value, *k.in_tangent, *k.out_tangent) for k in self.keys]
        return np.array(rows, dtype=np.float64)

    @property
    def time(self) -> Array:
        """(K,) key times in seconds."""
        return self.table[:, 0]

    @property
    def value(self) -> Array:
        """(K,) key values."""
        return self.table[:, 1]

    @property
    def start(self) -> float:
        """Time of the first key."""
        return self.keys[0].time

    @property
    def end(self) -> float:
        """Time of the last key."""
        return self.keys[-1].time

    @cached_property
    def controls(self) -> Array:
        """(K-1, 4, 2) Bézier control points of every span, tangents shortened where needed."""
        table = self.table
        span = np.diff(table[:, 0])[:, None]
        out, back = table[:-1, 4:6], table[1:, 2:4]
        backward = ~_is_monotone(out[:, :1] / span, 1.0 + back[:, :1] / span)
        shorter = np.minimum(1.0, span / np.maximum(out[:, :1], span))
        out = np.where(backward, out * shorter, out)
        shorter = np.minimum(1.0, span / np.maximum(-back[:, :1], span))
        back = np.where(backward, back * shorter, back)
        left, right = table[:-1, :2], table[1:, :2]
        return np.stack([left, left + out, right + back, right], axis=1)

    @cached_property
    def _steps(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        held = np.array([k.out_type == "stepped" for k in self.keys[:-1]], dtype=bool)
        nexts = np.array([k.out_type == "stepped_next" for k in self.keys[:-1]], dtype=bool)
        return held, nexts

    def evaluate(self, time: ArrayLike) -> Array:
        """Values at these times (any shape); constant outside the keys.

        Args:
            time: Times, s, of any shape.

        Returns:
            Values of that shape.
        """
        times = np.asarray(time, dtype=np.float64)
        flat = times.ravel()
        if len(self.keys) == 1:
            return np.full(times.shape, self.keys[0].value)
        span = np.clip(np.searchsorted(self.time, flat, side="right") - 1, 0, len(self.keys) - 2)
        controls = self.controls[span]
        width = controls[:, 3, 0] - controls[:, 0, 0]
        x = np.clip((flat - controls[:, 0, 0]) / width, 0.0, 1.0)
        u = solve_time(
            x,
            (controls[:, 1, 0] - controls[:, 0, 0]) / width,
            (controls[:, 2, 0] - controls[:, 0, 0]) / width,
        )
        result = bezier(controls[:, :, 1], u)
        held, nexts = (mask[span] for mask in self._steps)
        inside = (flat > controls[:, 0, 0]) & (flat < controls[:, 3, 0])
        result = np.where(held & inside, controls[:, 0, 1], result)
        result = np.where(nexts & inside, controls[:, 3, 1], result)
        result = np.where(flat <= self.start, self.keys[0].value, result)
        result = np.where(flat >= self.end, self.keys[-1].value, result)
        return result.reshape(times.shape)

    def sample(self, fps: float, start: float | None = None, end: float | None = None) -> Array:
        """Values at ``start, start + 1/fps, ...`` up to ``end`` (the keys' extent by default).

        Args:
            fps: Samples per second.
            start: First time, s.
            end: Last time, s.

        Returns:
            (N,) values.
        """
        first = self.start if start is None else start
        last = self.end if end is None else end
        count = max(1, math.floor((last - first) * fps + 1e-6) + 1)
        return self.evaluate(first + np.arange(count) / fps)

    def shifted(self, time: float = 0.0, value: float = 0.0) -> Curve:
        """The same curve elsewhere.

        Args:
            time: Added to every time, s.
            value: Added to every value.

        Returns:
            The shifted curve.
        """
        return replace(self, keys=tuple(k.moved(time, value) for k in self.keys))

    def scaled(self, time: float = 1.0, value: float = 1.0) -> Curve:
        """Stretched about the origin: tangents dx by ``time``, dy by ``value``.

        Args:
            time: Factor of every time, above 0.
            value: Factor of every value.

        Returns:
            The scaled curve.
        """
        if not (time > 0 and math.isfinite(time) and math.isfinite(value)):
            raise InputError(f"cannot scale a curve by {time:g} in time and {value:g} in value.")
        factor = np.array([time, value] * 3)
        kinds = [(k.in_type, k.out_type, k.broken) for k in self.keys]
        return Curve.from_table(self.table * factor, kinds, self.weighted)

    def with_keys_at(self, times: Iterable[float]) -> Curve:
        """Keys added without changing the curve (de Casteljau); outside its extent none are.

        Args:
            times: Where to add keys, s.

        Returns:
            The same curve with more keys.
        """
        curve = self
        for time in sorted(set(times)):
            if curve.start < time < curve.end and not np.any(curve.time == time):
                curve = curve._split(time)
        return curve

    def _split(self, time: float) -> Curve:
        i = int(np.searchsorted(self.time, time)) - 1
        left, right = self.keys[i], self.keys[i + 1]
        if left.out_type in ("stepped", "stepped_next"):
            value = left.value if left.out_type == "stepped" else right.value
            middle = Key(time, value, in_type=left.out_type, out_type=left.out_type)
            return replace(self, keys=(*self.keys[: i + 1], middle, *self.keys[i + 1 :]))
        points = self.controls[i]
        x = (points[:, 0] - points[0, 0]) / (points[3, 0] - points[0, 0])
        u = float(solve_time((time - left.time) / (right.time - left.time), x[1], x[2]))
        first = points[:-1] + u * np.diff(points, axis=0)
        second = first[:-1] + u * np.diff(first, axis=0)
        centre = second[0] + u * (second[1] - second[0])
        before = _offset(first[0] - points[0], 1)
        after = _offset(first[2] - points[3], -1)
        middle = Key(
            time, float(centre[1]), _offset(second[0] - centre, -1), _offset(second[1] - centre, 1)
        )
        left = replace(left, out_tangent=before, out_type="fixed")
        right = replace(right, in_tangent=after, in_type="fixed")
        return replace(self, keys=(*self.keys[:i], left, middle, right, *self.keys[i + 2 :]))

    def retangented(self) -> Curve:
        """Tangents of type auto, spline, linear and flat computed anew; fixed and stepped kept."""
        auto, spline = auto_slopes(self.time, self.value), spline_slopes(self.time, self.value)
        keys = []
        for i, key in enumerate(self.keys):
            slopes = {"auto": auto[i], "spline": spline[i], "flat": 0.0}
            changes: dict[str, tuple[float, float]] = {}
            for side, step in (("in", -1), ("out", 1)):
                kind = getattr(key, f"{side}_type")
                if kind not in _COMPUTED:
                    continue
                changes[f"{side}_tangent"] = self._computed(i, step, kind, slopes)
            keys.append(replace(key, **changes))  # type: ignore[arg-type]
        return replace(self, keys=tuple(keys))

    def _computed(
        self, i: int, step: int, kind: str, slopes: dict[str, float]
    ) -> tuple[float, float]:
        j = i + step
        if not 0 <= j < len(self.keys):
            return (0.0, 0.0)
        span = self.keys[j].time - self.keys[i].time  # negative on the in side
        rise = self.keys[j].value - self.keys[i].value
        slope = rise / span if kind == "linear" else float(slopes[kind])
        return (span / 3.0, slope * span / 3.0)


def _is_monotone(x1: Array, x2: Array) -> NDArray[np.bool_]:
    """Whether Bézier time 0, x1, x2, 1 never runs backward (x1 >= 0, x2 <= 1 given).

    Its derivative has Bernstein coefficients x1, x2 - x1, 1 - x2; this is their condition.
    """
    middle = x2 - x1
    return (middle >= 0) | (middle**2 <= x1 * (1.0 - x2) * (1.0 + 1e-9))


def _offset(vector: Array, side: int) -> tuple[float, float]:
    dx = float(vector[0])
    return (max(dx, 0.0) if side > 0 else min(dx, 0.0), float(vector[1]))


def _check_key(number: int, key: Key) -> None:
    numbers = (key.time, key.value, *key.in_tangent, *key.out_tangent)
    if not all(math.isfinite(x) for x in numbers):
        raise InputError(f"key {number} (t = {key.time:g} s) holds a value that is not finite.")
    if key.in_tangent[0] > 0 or key.out_tangent[0] < 0:
        raise InputError(
            f"key {number} (t = {key.time:g} s) has a tangent that points backward in time."
        )
    for kind in (key.in_type, key.out_type):
        if kind not in TANGENT_TYPES:
            raise InputError(
                f"key {number} has tangent type {kind!r}; it is one of {', '.join(TANGENT_TYPES)}."
            )
