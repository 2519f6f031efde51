"""stream: capture frames in, poses out, one by one."""

from __future__ import annotations

import gc
import json
import sys
import time as clock
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from physretarget import capture
from physretarget.capture.actor import CONTACT_POINTS, NQ, SEGMENTS, ActorShape
from physretarget.cli import app
from physretarget.cli.common import Given, command, say
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.listen import listen
from physretarget.mjcf import Character
from physretarget.options import STREAM, build
from physretarget.options.motion import Resampling
from physretarget.options.retargeting import StreamOptions, StreamSource
from physretarget.stream import Posed, Streamer
from physretarget.trained import TrainedMapper

Array = NDArray[np.float64]


@command(
    app,
    "stream",
    STREAM,
    example="physretarget stream --mapper lamp.npz --capture walk.bvh > poses.jsonl",
)
def stream_command(given: Given) -> None:
    """Retarget frame by frame: JSON lines in, JSON lines out.

    Reads standard input unless another source is given. docs/retarget.md describes a line.
    """
    source, delay = build(StreamSource, given), build(StreamOptions, given).delay
    if source.listen and source.capture:
        raise UsageError("--listen and --capture are both given; one of them is allowed.")
    mapper = source.mapper
    model = Character.load(source.character) if source.character else _shipped(mapper)
    trained = TrainedMapper.load(mapper, model)
    with _calm():
        if source.listen:
            _serve(trained, source.listen, delay)
        elif source.capture:
            rate = build(Resampling, given).resample
            _report(
                _run(trained, _played(source.capture, rate, given.get("map")), sys.stdout, delay)
            )
        else:
            _report(_run(trained, sys.stdin, sys.stdout, delay))


def _shipped(mapper: Path) -> Character:
    """The character of the package that the mapper was learned for."""
    for path in sorted(models_folder().glob("*.xml")):
        model = Character.load(path)
        try:
            TrainedMapper.load(mapper, model)
        except InputError as error:
            if "learned for" in str(error):
                continue
            raise
        return model
    raise UsageError("--character is needed: the mapper's character did not come with the package.")


@contextmanager
def _calm() -> Iterator[None]:
    """One BLAS thread, and no garbage collection of what was there before."""
    gc.collect()
    gc.freeze()
    with threadpool_limits(limits=1):
        yield
    gc.unfreeze()


def _run(
    trained: TrainedMapper, lines: Iterable[str], out: TextIO, delay: float = 0.0
) -> list[float]:
    """Answer every line; returns the seconds that each took, parsing and printing included."""
    streamer = Streamer(trained, delay=delay)
    spent = []

    def say_pose(posed: Posed | None, seconds: float) -> None:
        if posed is not None:
            out.write(answer(posed, streamer, seconds) + "\n")
            out.flush()

    for number, line in enumerate(lines):
        if not line.strip():
            continue
        began = clock.perf_counter()
        time, qpos = parse(line, number)
        posed = streamer.next(time, qpos)
        say_pose(posed, clock.perf_counter() - began)
        spent.append(clock.perf_counter() - began)
    for posed in streamer.rest():
        say_pose(posed, 0.0)
    return spent


def parse(line: str, number: int) -> tuple[float, Array]:
    """Time and actor qpos (75,) of one line.

    Either ``qpos`` of the reference actor, or ``position`` of the pelvis joint and ``joints``:
    name to quaternion w x y z against the parent segment, identity where left out.

    Raises:
        InputError: with the number of the frame.
    """
    try:
        told: Any = json.loads(line)
        time = float(told["time"])
        if "qpos" in told:
            return time, np.array(told["qpos"], dtype=np.float64)
        qpos = np.zeros(NQ)
        qpos[3::4] = 1.0
        qpos[:3] = told["position"]
        for name, quat in told["joints"].items():
            at = 3 + 4 * SEGMENTS.index(name)
            qpos[at : at + 4] = np.array(quat) / np.linalg.norm(quat)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            'a frame is {"time": s, "qpos": [75 numbers]} or {"time": s, "position": [x, y, z], '
            f'"joints": {{segment: [w, x, y, z]}}}}; this one is not ({error}).',
            frame=number,
        ) from error
    return time, qpos


def answer(posed: Posed, streamer: Streamer, seconds: float) -> str:
    """One line of JSON."""
    names = streamer.character.contacts.names
    landing = posed.touch.landing
    ahead = {
        name: round(float(landing[i]), 4)
        for i, name in enumerate(CONTACT_POINTS)
        if 0 < landing[i] < np.inf
    }
    return json.dumps(
        {
            "time": posed.time,
            "qpos": [round(v, 7) for v in posed.qpos.tolist()],
            "contacts": [n for n, on in zip(names, posed.active.tolist(), strict=True) if on],
            "landing": ahead,
            "doubt_m": round(float(np.sqrt(max(posed.variance, 0.0))), 5),
            "latency_ms": round(1e3 * seconds, 3),
        }
    )


def _played(path: Path, fps: float | None, map: Path | None) -> Iterator[str]:
    motion = capture.load(path, map=map)
    if fps is not None:
        motion = motion.resampled(fps)
    motion = motion.on(ActorShape.reference())
    for time, qpos in zip(motion.time[motion.valid], motion.qpos[motion.valid], strict=True):
        yield json.dumps({"time": float(time), "qpos": qpos.tolist()})


def _serve(trained: TrainedMapper, place: str, delay: float = 0.0) -> None:
    """One connection after the other, each a stream of its own, until interrupted."""
    host, _, port = place.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"--listen is {place!r}; it must be HOST:PORT.")
    with listen(host, int(port)) as server:
        say(f"listening on {host}:{server.getsockname()[1]}")
        while True:
            connection, _address = server.accept()
            with connection, connection.makefile("rw", encoding="utf-8") as file:
                try:
                    _report(_run(trained, file, file, delay))
                except InputError as error:
                    file.write(json.dumps({"error": str(error)}) + "\n")
                except (ConnectionError, BrokenPipeError):
                    say("the other side hung up.")


def _report(spent: list[float]) -> None:
    if spent:
        median, late = 1e3 * np.percentile(spent, [50, 99])
        say(f"{len(spent)} frames; latency {median:.2f} ms median, {late:.2f} ms 99th percentile.")
