"""Do suggested key poses help more than evenly spaced or random ones, at equal budget?

    python -m benchmarks.suggest [--data ../shared/data] [--mapper gp] [--seeds 20]
    python -m benchmarks.suggest --curve docs/measured/images/suggest.png

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


WORKED = (3, 5, 7, 10, 14, 20, 28, 40, 55)
"""How many suggestions have been posed."""


@one_thread
def worked_through(y: Array, z: Array, seeds: int, height: float) -> tuple[Array, Array]:
    """(seeds, len(WORKED)) error that the studio expects, and on held-out poses, % of the height.

    The poses are an animator's: two thirds of the shipped ones are the frames that can be
    suggested, the rest are held out.
    """
    expected, real = np.empty((seeds, len(WORKED))), np.empty((seeds, len(WORKED)))

    def rms(miss: Array) -> float:
        squared = np.sum(miss.reshape(len(miss), -1, 3) ** 2, axis=2)
        return 100 * float(np.sqrt(np.mean(squared))) / height

    for seed in range(seeds):
        held = np.sort(np.random.default_rng(seed).permutation(len(y))[: len(y) // 3])
        kept = np.setdiff1d(np.arange(len(y)), held)
        picked = kept[[s.index for s in suggest(y[kept], y[:0], count=max(WORKED))]]
        for k, budget in enumerate(WORKED):
            now = picked[:budget]
            mapper = mapping.fit("sgplvm", y[now], z[now], dims=min(8, budget - 1), seed=0)
            expected[seed, k] = 100 * mapper.predict(y[held]).expected_error / height
            real[seed, k] = rms(mapper.predict(y[held]).mean - z[held])
    return expected, real


def curve(told: argparse.Namespace) -> None:
    """Print the table of expected and real errors and draw it."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, places = plt.subplots(1, 3, figsize=(11, 3.4), sharey=True, layout="constrained")
    print("| | " + " | ".join(map(str, WORKED)) + " |\n|---|" + "---|" * len(WORKED))
    for axes, name in zip(places, ("lamp", "penguin", "squirrel"), strict=True):
        y, z, _, character = read(name, None)
        expected, real = worked_through(y, z, told.seeds, character.height)
        for what, values, colour in (
            ("expected", expected, "tab:blue"), ("on held-out poses", real, "tab:orange"),
        ):  # fmt: skip
            middle, spread = values.mean(axis=0), values.std(axis=0)
            print(f"| {name}, {what} | " + " | ".join(f"{v:.1f}" for v in middle) + " |")
            axes.plot(WORKED, middle, "o-", color=colour, label=what, markersize=3)
            axes.fill_between(WORKED, middle - spread, middle + spread, color=colour, alpha=0.15)
        axes.set(title=name, xlabel="key poses posed", ylim=(0, 40))
        axes.grid(alpha=0.3)
    places[0].set_ylabel("RMS error, % of the height")
    places[0].legend()
    figure.savefig(told.curve, dpi=110)


def read(
    name: str, data: Path | None
) -> tuple[Array, Array, Callable[[NDArray[np.int64]], tuple[Array, Array]], Character]:
    """A character's pairs by capture and time, and what chooses out of frames of the captures."""
    character = Character.load(MODELS / f"{name}.xml")
    files = [MODELS / f"{name}{kind}.keyposes.toml" for kind in ("", ".bandai-nc")]
    poses = keyposes.load_keyposes([f for f in files if f.is_file()], character)
    order = ordered(poses)
    y, z = (each[order] for each in keyposes.training_pairs(poses, character))
    sources = [poses.poses[i].source for i in order]
    oracle = mapping.fit("sgplvm", y, z, seed=0)
    actor = keyposes.actor_character_of_reference()
    taken = frames_of(list(dict.fromkeys(sources)), data, actor)
    posed = {name: oracle.predict(frames).mean for name, frames in taken.items()}

    def from_captures(kept: NDArray[np.int64]) -> tuple[Array, Array]:
        names = [n for n in dict.fromkeys(sources[i] for i in kept) if n in taken]
        return np.concatenate([taken[n] for n in names]), np.concatenate([posed[n] for n in names])

    return y, z, from_captures, character


def main() -> None:
    """Both studies, or the curve."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--data", type=Path, default=MODELS.parents[1] / "shared" / "data")
    options.add_argument("--mapper", default="gp")
    options.add_argument("--character", default="lamp")
    options.add_argument("--seeds", type=int, default=20)
    options.add_argument("--curve", type=Path, metavar="PICTURE.png")
    told = options.parse_args()
    if told.curve is not None:
        curve(told)
        return
    y, z, from_captures, character = read(told.character, told.data)
    common = {"seeds": told.seeds, "height": character.height}
    print(
        f"{told.character}, {told.mapper}, {len(y)} pairs; RMS error on held-out pairs, percent of"
    )
    print("the height, mean ± deviation over the splits, share of splits better than evenly spaced")
    print("\npairs\n")
    study(told.mapper, y, z, lambda kept: (y[kept], z[kept]), **common)  # type: ignore[arg-type]
    print("\nframes\n")
    study(told.mapper, y, z, from_captures, **common)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
