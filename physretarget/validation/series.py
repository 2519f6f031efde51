"""What is known of every frame of a clip, gathered chunk by chunk and read one array at a time.

T frames; BW is body weight, h the CoM's height in the reference pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from physretarget.clip.scratch import Scratch
from physretarget.ground.sliding import Arrows, Skate
from physretarget.validation.declared import DeclaredContacts
from physretarget.validation.external_contacts import ExternalTouch
from physretarget.validation.least_torque import TorqueShare
from physretarget.validation.selfcollision import Overlap
from physretarget.validation.smoothness import Jerk

Array = NDArray[np.generic]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class JointSpeed:
    """The joint that moves fastest.

    Attributes:
        speed: (T,) rad/s or m/s.
        dof: (T,) its degree of freedom.
    """

    speed: Floats
    dof: Ints


@dataclass(frozen=True, eq=False)
class LimitExcess:
    """The joint that is furthest beyond its range, before the filter.

    Attributes:
        excess: (T,) rad or m, 0 where all are within theirs.
        coordinate: (T,) its index in qpos.
    """

    excess: Floats
    coordinate: Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class FloorTouch:
    """What of the character touches the floor.

    Attributes:
        lowest: (T,) m above the floor of what may touch.
        lowest_body: (T,) the body it is of.
        deepest: (T,) m, the same as filtered or as given, whichever is higher.
        deepest_body: (T,) the body it is of.
        clearance: (T,) m by which no point touches, below 0 where one does.
        points: (T,) how many touch.
        bodies: (T, bodies) which touch.
        grip: (T,) the highest friction coefficient of what touches, NaN for nothing.
    """

    lowest: Floats
    lowest_body: Ints
    deepest: Floats
    deepest_body: Ints
    clearance: Floats
    points: Ints
    bodies: Bools
    grip: Floats


@dataclass(frozen=True, eq=False)
class Requirement:
    """What the floor must supply for the character to move so.

    Attributes:
        force: (T, 3) BW.
        moment: (T, 3) BW h about the CoM.
        com: (T, 3) m, the centre of mass.
        root_acceleration: (T,) m/s^2.
    """

    force: Floats
    moment: Floats
    com: Floats
    root_acceleration: Floats


@dataclass(frozen=True, eq=False)
class Bearing:
    """The contact forces that explain the required force.

    Attributes:
        supported: (T,) whether something touches in this frame or within reach of its force.
        force: (T, 3) BW, their sum.
        moment_rest: (T, 3) BW h of the required moment that they leave.
        arm: (T, 3) h, the mean arm about the CoM of what may bear, zero for nothing.
    """

    supported: Bools
    force: Floats
    moment_rest: Floats
    arm: Floats


@dataclass(frozen=True, eq=False)
class Pushes:
    """What pushes of any floor look like, of the whole clip.

    Attributes:
        ringing: (T,) BW that the filter makes of pushes anywhere.
        friction_demand: (T,) friction coefficient, NaN where nothing is supported.
    """

    ringing: Floats
    friction_demand: Floats


@dataclass(frozen=True, eq=False)
class Residual:
    """What no contact explains, of the whole clip: see :mod:`physretarget.ground.response`.

    Attributes:
        explained: (T, 3) BW, the nearest to the required force that forces in their cones near
            contacts look like after the filter.
        force: (T,) BW, the rest.
        side_lobes: (T,) BW h that the filter may make of shocks around.
        moment: (T,) BW h, what the contacts' moment leaves, less the side lobes.
        cop_outside: (T,) m that the centre of pressure would have to lie outside what supports,
            NaN where nothing does.
    """

    explained: Floats
    force: Floats
    side_lobes: Floats
    moment: Floats
    cop_outside: Floats


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameSeries:
    """All that is known of some frames; None for what could not be computed."""

    joint_speed: JointSpeed | None = None
    limit_excess: LimitExcess | None = None
    jerk: Jerk | None = None
    overlap: Overlap | None = None
    external: ExternalTouch | None = None
    floor: FloorTouch | None = None
    declared: DeclaredContacts | None = None
    required: Requirement | None = None
    bearing: Bearing | None = None
    skate: Skate | None = None
    arrows: Arrows | None = None
    torque: TorqueShare | None = None
    pushes: Pushes | None = None
    residual: Residual | None = None


@dataclass(frozen=True, eq=False)
class ForceSeries:
    """Those that contact forces are judged by: where one can be computed, all can."""

    floor: FloorTouch
    required: Requirement
    bearing: Bearing
    residual: Residual


class Gathered:
    """Frame series that came in parts: in memory while few, on disk beyond."""

    def __init__(self) -> None:
        self._scratch = Scratch()
        self._groups: dict[str, type[Any]] = {}
        # Of every array: type, shape of a frame, and place and frames of every part.
        self._kinds: dict[tuple[str, str], tuple[np.dtype[Any], tuple[int, ...]]] = {}
        self._parts: dict[tuple[str, str], list[tuple[int, int]]] = {}

    def add(self, part: FrameSeries) -> None:
        """Further frames of those that it has."""
        for name in (each.name for each in fields(part)):
            group = getattr(part, name)
            if group is None:
                continue
            self._groups[name] = type(group)
            for column in (each.name for each in fields(group)):
                key, array = (name, column), _slim(getattr(group, column))
                self._kinds.setdefault(key, (array.dtype, array.shape[1:]))
                assert self._kinds[key] == (array.dtype, array.shape[1:]), key
                self._parts.setdefault(key, []).append((self._scratch.add(array), len(array)))

    @property
    def series(self) -> FrameSeries:
        """All frames so far.

        Every look at an array reads it anew, so that memory holds what is being worked on and no
        more.
        """
        return FrameSeries(**{name: self._stored(name) for name in self._groups})

    def _stored(self, name: str) -> Any:
        """A group whose arrays are read when they are asked for."""
        kind = self._groups[name]

        def reader(column: str) -> property:
            return property(lambda _: self._read(name, column))

        readers = {each.name: reader(each.name) for each in fields(kind)}
        return object.__new__(type(kind.__name__, (kind,), readers))

    def _read(self, name: str, column: str) -> Array:
        parts, (dtype, shape) = self._parts[name, column], self._kinds[name, column]
        each = math.prod(shape)
        array = np.empty((sum(frames for _, frames in parts), *shape), _WIDE[dtype.kind])
        first = 0
        for place, frames in parts:
            part = self._scratch.get(place, frames * each, dtype)
            array[first : first + frames] = part.reshape(frames, *shape)
            first += frames
        return array


# As they are kept and as they are read: in single precision, six digits of whatever they measure.
_SLIM: Mapping[str, type[np.generic]] = {"b": np.bool_, "i": np.int32, "f": np.float32}
_WIDE: Mapping[str, type[np.generic]] = {"b": np.bool_, "i": np.int64, "f": np.float64}


def _slim(array: Array) -> Array:
    return cast("Array", array.astype(_SLIM[array.dtype.kind]))


class Timelines(Mapping[str, NDArray[np.float32]]):
    """Arrays that are made when they are asked for; a copy in another process holds them all."""

    def __init__(self, makers: Mapping[str, Callable[[], Array]]) -> None:
        self._makers = dict(makers)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        return np.ascontiguousarray(self._makers[name](), dtype=np.float32)

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return dict, (dict(self),)
