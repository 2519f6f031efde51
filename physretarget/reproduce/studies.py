"""The paper's studies of the mapping: latent dimension, iterations, mappers, fewer key poses."""

from __future__ import annotations

import time as clock
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import capture, mapping
from physretarget.capture.actor import ActorShape
from physretarget.features import features
from physretarget.mapping import Mapper, SharedGPLVM
from physretarget.mapping.latent import latent_map
from physretarget.mapping.search import SearchSettings
from physretarget.mjcf import actor_character
from physretarget.mjcf.dynamics import lowpass
from physretarget.reproduce.holdout import (
    LEVELS,
    jerk_rms,
    largest_step,
    marker_jerk,
    marker_rms,
    unseen,
)
from physretarget.reproduce.plan import Plan, Take, keypose_files
from physretarget.reproduce.reach import reach
from physretarget.reproduce.store import Piece, key_of, load, save
from physretarget.reproduce.subject import subject

Array = NDArray[np.float64]
DIMS = (2, 5, 10, 15, 30)
SHOWN_DIMS = (2, 15, 30)
ITERATIONS = (10, 20, 40, 70, 150, 300)
FIGURE_6 = ("happy", "bye")
"""Style and action of the take in Figure 6: the paper shows the happy lamp."""


@lru_cache(maxsize=64)
def actor_features(path: Path) -> tuple[Array, float]:
    """Features (T, DY) of a capture on the reference actor, low-passed, and its rate."""
    motion = capture.load(path)
    if motion.fps > 60:
        motion = motion.resampled(60.0)
    actor = actor_character(motion.shape)
    motion = replace(motion, qpos=lowpass(actor, motion.qpos, motion.fps, 6.0))
    reference = motion.on(ActorShape.reference())
    return features(actor_character(ActorShape.reference()), reference.qpos), motion.fps


def _keyed(
    kind: str, plan: Plan, name: str, out: Path, captures: tuple[Take, ...] = ()
) -> tuple[Path, str]:
    files = [plan.models / f"{name}.xml", *keypose_files(plan.models, name)]
    key = key_of(kind, name, *files, *(take.capture for take in captures))
    return out / "studies" / f"{kind}-{name}", key


def _as_paper(mapper: Mapper) -> Mapper:
    """The same model searched as in the paper: from the nearest key pose, without a guide."""
    assert isinstance(mapper, SharedGPLVM)
    return replace(mapper, search=SearchSettings(guide=0.0))


def do_dimensions(plan: Plan, name: str, out: Path) -> Piece:
    """Both of the paper's criteria for D_X, and Figure 6."""
    captures = tuple(take for take in plan.captures() if take.style == FIGURE_6[0])
    folder, key = _keyed("dimensions", plan, name, out, captures)
    if (done := load(folder, key)) is not None:
        return done
    began = clock.perf_counter()
    own = subject(plan.models, name)
    tracks = [actor_features(take.capture) for take in captures]
    fps = [rate for _, rate in tracks]
    shown = next((t for t in captures if t.action == FIGURE_6[1]), captures[0])
    rows, arrays = [], {}
    for dims in DIMS:
        mapper = mapping.fit("sgplvm", own.y, own.z, dims=dims)
        assert isinstance(mapper, SharedGPLVM)
        row: dict[str, Any] = {"dims": dims}
        for search, one in (("guided", mapper), ("paper", _as_paper(mapper))):
            mapped = [one.predict(y) for y, _ in tracks]
            row[search] = {
                "keypose_error": marker_rms(one.predict(own.y).mean - own.z),
                "jerk": marker_jerk([m.mean for m in mapped], fps),
                "latent_jerk": jerk_rms([_of(m.latent) for m in mapped], fps)
                / _spread(mapper.latent),
                "fastest": largest_step([m.mean for m in mapped], fps),
            }
            if dims in SHOWN_DIMS:
                way = _of(mapped[captures.index(shown)].latent)
                found = latent_map(mapper, way)
                tag = f"{dims}_{search}"
                arrays[f"way_{tag}"] = found.trajectory
                arrays[f"keys_{tag}"] = found.keys
                arrays[f"variance_{tag}"] = found.variance
                arrays[f"extent_{tag}"] = np.array(
                    [found.grid_x[0], found.grid_x[-1], found.grid_y[0], found.grid_y[-1]]
                )

        def learn(y: Array, z: Array, d: int = dims) -> Mapper:
            return mapping.fit("sgplvm", y, z, dims=d, calibrated=False)

        row["unseen"] = unseen(learn, own.y, own.z, own.sequence).error
        rows.append(row)
    arrays["own"] = np.array([s == shown.capture.name for s in own.sources], dtype=np.float64)
    facts = {
        "rows": rows,
        "height": own.character.height,
        "shown": shown.capture.name,
        "captures": [take.capture.name for take in captures],
        "seconds": clock.perf_counter() - began,
    }
    save(folder, key, facts, arrays)
    return Piece(facts, arrays)


def _of(latent: Array | None) -> Array:
    assert latent is not None
    return latent


def _spread(latent: Array) -> float:
    """RMS distance of the key poses' latent points from their centre."""
    return float(np.sqrt(np.mean(np.sum((latent - latent.mean(axis=0)) ** 2, axis=1))))


def do_iterations(plan: Plan, name: str, out: Path) -> Piece:
    """Errors on seen and unseen key poses against the iterations of the learning."""
    folder, key = _keyed("iterations", plan, name, out)
    if (done := load(folder, key)) is not None:
        return done
    began = clock.perf_counter()
    own = subject(plan.models, name)
    rows = []
    for count in ITERATIONS:

        def learn(y: Array, z: Array, n: int = count) -> Mapper:
            return mapping.fit("sgplvm", y, z, iterations=n, calibrated=False)

        mapper = learn(own.y, own.z)
        rows.append(
            {
                "iterations": count,
                "keypose_error": marker_rms(mapper.predict(own.y).mean - own.z),
                "unseen": unseen(learn, own.y, own.z, own.sequence).error,
            }
        )
    facts = {
        "rows": rows,
        "height": own.character.height,
        "seconds": clock.perf_counter() - began,
    }
    save(folder, key, facts, {})
    return Piece(facts, {})


def do_mappers(plan: Plan, name: str, out: Path) -> Piece:
    """Yamane 2010, 6.4: five mappers, held-out errors, smoothness, calibration."""
    captures = tuple(take for take in plan.captures() if take.style != "dance")
    folder, key = _keyed("mappers", plan, name, out, captures)
    if (done := load(folder, key)) is not None:
        return done
    began = clock.perf_counter()
    own = subject(plan.models, name)
    tracks = [actor_features(take.capture) for take in captures]
    fps = [rate for _, rate in tracks]
    groups = {
        "pose": tuple(range(len(own.y))),
        "take": own.sources,
        "sequence": own.sequence,
    }
    rows = []
    for which in mapping.NAMES:

        def learn(y: Array, z: Array, kind: str = which) -> Mapper:
            return mapping.fit(kind, y, z)

        mapper = learn(own.y, own.z)
        mapped = [mapper.predict(y).mean for y, _ in tracks]
        row: dict[str, Any] = {
            "mapper": which,
            "seen": marker_rms(mapper.predict(own.y).mean - own.z),
            "jerk": marker_jerk(mapped, fps),
            "fastest": largest_step(mapped, fps),
        }
        for group, labels in groups.items():
            found = unseen(learn, own.y, own.z, labels)
            row[group] = found.error
            row[f"{group}_by_sequence"] = _by_sequence(found.mean - own.z, own.sequence)
            row[f"{group}_inside"] = {k: found.inside(v) for k, v in LEVELS.items()}
        rows.append(row)
    facts = {
        "rows": rows,
        "height": own.character.height,
        "poses": len(own.y),
        "captures": len(captures),
        "groups": {k: len(set(v)) for k, v in groups.items()},
        "seconds": clock.perf_counter() - began,
    }
    save(folder, key, facts, {})
    return Piece(facts, {})


def _by_sequence(miss: Array, sequence: tuple[str, ...]) -> dict[str, float]:
    return {
        name: marker_rms(miss[np.array([s == name for s in sequence])])
        for name in dict.fromkeys(sequence)
    }


def do_reach(plan: Plan, name: str, out: Path) -> Piece:
    """Extremes with fewer key poses: those of the happy takes, or of the jump, removed."""
    folder, key = _keyed("reach", plan, name, out)
    if (done := load(folder, key)) is not None:
        return done
    began = clock.perf_counter()
    own = subject(plan.models, name)
    happy = np.array([s == "happy" for s in own.sequence])
    names = [pose.name for pose in own.keyposes.poses]
    # The paper took out seven; of the jump, those seven around its highest point.
    jump = np.array([s == "humanoid3d_jump" for s in own.sequence])
    highest = np.zeros(len(names), dtype=bool)
    if jump.any():
        lowest = own.z[:, 2::3].min(axis=1)
        at = np.array([pose.time for pose in own.keyposes.poses])
        apex = at[jump][np.argmax(lowest[jump])]
        order = [i for i in np.argsort(np.abs(at - apex), kind="stable") if jump[i]]
        highest[order[:7]] = True
    cases = []
    for label, out_of in (("happy", happy), ("jump", highest)):
        if out_of.any():
            rows = [reach(own, which, out_of) for which in mapping.NAMES]
            removed = [n for n, gone in zip(names, out_of, strict=True) if gone]
            cases.append({"case": label, "removed": removed, "rows": rows})
    facts = {"cases": cases, "seconds": clock.perf_counter() - began}
    save(folder, key, facts, {})
    return Piece(facts, {})
