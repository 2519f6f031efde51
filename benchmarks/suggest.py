"""Do suggested key poses help more than evenly spaced or random ones, at equal budget?

    python benchmarks/suggest.py [--data ../shared/data] [--mapper gp] [--seeds 20]

The shipped key poses are the oracle: what an animator did pose. Two studies, both on error over
key poses that were held out (a third of all, drawn anew for each of the seeds):

pairs   choose out of the remaining pairs, which an animator has picked well already;
frames  choose out of all frames of the captures that the remaining pairs come from, ten per
        second; what the animator would pose there is read off a mapper that learned all pairs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget import capture, keyposes, mapping
from physretarget.capture.actor import ActorShape
from physretarget.demo import motions_folder
from physretarget.features import features
from physretarget.keyposes.suggest import suggest
from physretarget.mapping.kernels import squared_distances
from physretarget.mapping.threads import one_thread
from physretarget.mjcf import Character

Array = NDArray[np.float64]
MODELS = Path(__file__).resolve().parents[1] / "models"
BUDGETS = (10, 20, 30)
Choose = Callable[[Array, Array, int, np.random.Generator], NDArray[np.int64]]
"""(frames, oracle poses, budget, randomness) → which frames."""


def suggested(y: Array, z: Array, budget: int, _: np.random.Generator) -> NDArray[np.int64]:
    """What ``keyposes suggest`` chooses before anything is posed."""
    return np.array([s.index for s in suggest(y, y[:0], count=budget)])


def averaged(y: Array, z: Array, budget: int, _: np.random.Generator) -> NDArray[np.int64]:
    """Each the frame that takes most variance away from all frames together (Cohn 1996)."""
    some = y[:: max(len(y) // 300, 1)]
    squared = squared_distances(some, some)
    median = float(np.median(squared[np.triu_indices_from(squared, k=1)]))
    covariance = np.exp(-0.5 * squared_distances(y, y) / median)
    chosen: list[int] = []
    for _step in range(budget):
        variance = np.diagonal(covariance) + 1e-3
        gain = np.sum(covariance**2, axis=0) / variance
        gain[chosen] = -1.0
        chosen.append(int(np.argmax(gain)))
        column = covariance[:, chosen[-1]] / np.sqrt(variance[chosen[-1]])
        covariance = covariance - np.outer(column, column)
    return np.array(chosen)


def farthest(y: Array, z: Array, budget: int, _: np.random.Generator) -> NDArray[np.int64]:
    """Each the farthest from those before (k-centre): coverage alone."""
    chosen = [int(np.argmin(np.sum((y - y.mean(axis=0)) ** 2, axis=1)))]
    distance = np.sum((y - y[chosen[0]]) ** 2, axis=1)
    while len(chosen) < budget:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.sum((y - y[chosen[-1]]) ** 2, axis=1))
    return np.array(chosen)


def uniform(y: Array, z: Array, budget: int, _: np.random.Generator) -> NDArray[np.int64]:
    """Evenly spaced in time over the captures, one after the other."""
    return np.round((np.arange(budget) + 0.5) * len(y) / budget - 0.5).astype(np.int64)


def random(y: Array, z: Array, budget: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Without replacement."""
    return rng.choice(len(y), budget, replace=False)


METHODS: dict[str, Choose] = {
    "suggested": suggested,
    "least variance on average": averaged,
    "farthest first": farthest,
    "evenly spaced": uniform,
    "random": random,
}


def ordered(poses: keyposes.KeyPoseSet) -> list[int]:
    """Numbers of the pairs by capture and time."""
    order = {name: i for i, name in enumerate(dict.fromkeys(p.source for p in poses.poses))}
    return sorted(
        range(len(poses)), key=lambda i: (order[poses.poses[i].source], poses.poses[i].time)
    )


def frames_of(sources: list[str], folder: Path | None, actor: Character) -> dict[str, Array]:
    """Features (M, DY) of each capture that is at hand, ten frames per second."""
    found = {}
    for name in sources:
        path = motions_folder() / name
        if not path.is_file() and folder is not None:
            path = next(iter(folder.rglob(name)), path)
        if path.is_file():
            motion = capture.load(path).resampled(10.0)
            found[name] = features(actor, motion.on(ActorShape.reference()).qpos[motion.valid])
    return found


@one_thread
def study(
    mapper: str,
    y: Array,
    z: Array,
    pools: Callable[[NDArray[np.int64]], tuple[Array, Array]],
    *,
    seeds: int,
    height: float,
) -> None:
    """Print a table of RMS marker errors on held-out pairs, percent of the height."""
    errors: dict[tuple[str, int], list[float]] = {}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        held = np.sort(rng.permutation(len(y))[: len(y) // 3])
        kept = np.setdiff1d(np.arange(len(y)), held)
        pool_y, pool_z = pools(kept)
        for name, choose in METHODS.items():
            for budget in BUDGETS:
                picked = choose(pool_y, pool_z, budget, rng)
                learned = mapping.fit(mapper, pool_y[picked], pool_z[picked], seed=0)
                miss = (learned.predict(y[held]).mean - z[held]).reshape(len(held), -1, 3)
                rms = float(np.sqrt(np.mean(np.sum(miss**2, axis=2)))) / height
                errors.setdefault((name, budget), []).append(100 * rms)
    print("| | " + " | ".join(f"{b} poses" for b in BUDGETS) + " |")
    print("|---|" + "---|" * len(BUDGETS))
    for name in METHODS:
        cells = []
        for budget in BUDGETS:
            own = np.array(errors[name, budget])
            wins = float(np.mean(own < np.array(errors["evenly spaced", budget])))
            beside = f", {wins:.0%}" if name != "evenly spaced" else ""
            cells.append(f"{own.mean():.2f} ± {own.std():.2f}{beside}")
        print(f"| {name} | " + " | ".join(cells) + " |")


def main() -> None:
    """Both studies."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=MODELS.parents[1] / "shared" / "data")
    options.add_argument("--mapper", default="gp")
    options.add_argument("--character", default="lamp")
    options.add_argument("--seeds", type=int, default=20)
    told = options.parse_args()
    character = Character.load(MODELS / f"{told.character}.xml")
    files = [MODELS / f"{told.character}{kind}.keyposes.toml" for kind in ("", ".bandai-nc")]
    poses = keyposes.load_keyposes(files, character)
    order = ordered(poses)
    y, z = (each[order] for each in keyposes.training_pairs(poses, character))
    sources = [poses.poses[i].source for i in order]
    actor = keyposes.actor_character_of_reference()
    common = {"seeds": told.seeds, "height": character.height}
    print(
        f"{told.character}, {told.mapper}, {len(y)} pairs; RMS error on held-out pairs, percent of"
    )
    print("the height, mean ± deviation over the splits, share of splits better than evenly spaced")
    print("\npairs\n")
    study(told.mapper, y, z, lambda kept: (y[kept], z[kept]), **common)  # type: ignore[arg-type]
    oracle = mapping.fit("sgplvm", y, z, seed=0)
    taken = frames_of(list(dict.fromkeys(sources)), told.data, actor)
    posed = {name: oracle.predict(frames).mean for name, frames in taken.items()}

    def from_captures(kept: NDArray[np.int64]) -> tuple[Array, Array]:
        names = [n for n in dict.fromkeys(sources[i] for i in kept) if n in taken]
        return np.concatenate([taken[n] for n in names]), np.concatenate([posed[n] for n in names])

    print(f"\nframes ({sum(map(len, taken.values()))} of {len(taken)} captures)\n")
    study(told.mapper, y, z, from_captures, **common)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
