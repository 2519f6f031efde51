"""Keys that the capture itself asks for: the programme, what past shots teach of it, and doubt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from physretarget.face.borrowed import draft_of_claims, from_itself
from physretarget.face.curve import Key
from physretarget.face.job import Banks, Draft, Job, corners
from physretarget.face.keyfit import Chain, key_table
from physretarget.face.library import Library
from physretarget.face.programme import ProgrammeSettings, Score, programme, whole_rest
from physretarget.face.result import MatchSettings
from physretarget.face.rig import Rig
from physretarget.face.sides import together
from physretarget.face.sources import Piece, Shapes, named, span_sources
from physretarget.face.spans import HOLD, KINDS
from physretarget.face.style import Clues, Style, keyed_by, learn


def by_programme(
    job: Job,
    library: Library,
    rig: Rig,
    settings: MatchSettings,
    banks: Banks,
    progress: Callable[[str], None],
) -> list[Draft]:
    """The default: keys where the take's own likelihood and prices put them."""
    wanted = ProgrammeSettings(key_price=settings.key_cost, level=settings.fidelity)
    pinned = [list(frames) for frames in job.locked]
    scores = _scores(job, library, settings, wanted, pinned, banks, progress)
    names = [channel.name for channel in job.channels]
    scores = together(
        names, scores, job.values, job.smooth, job.take.fps, settings.key_cost, pinned
    )
    drafts = []
    for row, (channel, score) in enumerate(zip(job.channels, scores, strict=True)):
        whole = from_itself(job, row, library, rig, banks)
        if whole:
            drafts.append(draft_of_claims(job, row, whole, library))
            continue
        still = np.ptp(job.values[row]) < 1e-9 and not job.locked[row]
        chain = whole_rest(len(job.take.time)) if still else score.chain
        patterns = tuple(rig.library.get(channel.group, ()))
        if patterns not in banks.shapes:
            banks.shapes[patterns] = Shapes.of(
                library,
                lambda name, g=channel.group: rig.borrows(g, name),  # type: ignore[misc]
            )
        drafts.append(
            _draft_of_chain(job, row, chain, score, library, banks.shapes[patterns], settings)
        )
    return drafts


def _scores(
    job: Job,
    library: Library,
    settings: MatchSettings,
    wanted: ProgrammeSettings,
    pinned: list[list[int]],
    banks: Banks,
    progress: Callable[[str], None],
) -> list[Score]:
    """The programme's, and the style's where the library has one; channels at rest stay at rest."""
    style = None
    fps = round(job.take.fps, 3)
    if settings.learned:
        if (fps, wanted) not in banks.styles:

            def learned() -> Style | None:
                return learn(library, fps, wanted, progress=progress)

            file = banks.style_file
            banks.styles[fps, wanted] = (
                learned() if file is None else file.get(library, fps, wanted, learned)
            )
        style = banks.styles[fps, wanted]
    progress(f"{len(job.channels)} channels")
    scores = programme(job.values, job.take.fps, wanted, pinned=pinned)
    if style is None:
        return scores
    keyed = keyed_by(style, Clues(scores, job.values, job.take.fps), pinned)
    rests = [(s.chain.kinds == HOLD).all() for s in scores]
    return [a if rest else b for a, b, rest in zip(scores, keyed, rests, strict=True)]


def _draft_of_chain(
    job: Job,
    row: int,
    chain: Chain,
    score: Score,
    library: Library,
    shapes: Shapes,
    settings: MatchSettings,
) -> Draft:
    values, frames = job.values[row], chain.frames
    number = {int(f): k for k, f in enumerate(frames)}
    pins = {number[f]: key for f, key in job.locked[row].items() if f in number}
    chain = _free_holds(chain, pins)
    table = key_table(chain, values, score.weight, pins)
    held = np.array([k in pins for k in range(len(frames))], dtype=np.bool_)
    origins = span_sources(chain, values, score.weight, shapes)
    wide = 2 * max(1, round(job.take.fps / 30.0)) + 1  # frames: a thirtieth of a second either way
    near = np.convolve(score.likely, np.ones(wide), mode="same")[: len(score.likely)]
    near[[0, -1]] = 1.0
    time = job.take.time
    pieces = []
    for k, (origin, margin) in enumerate(origins):
        first, last = int(frames[k]), int(frames[k + 1])
        kind = KINDS[chain.kinds[k]].name
        sure = float(min(1.0, near[first], near[last]))
        piece = Piece(float(time[first]), float(time[last]), kind, confidence=sure, margin=margin)
        told = {}
        if origin is not None:
            height = abs(float(table[k + 1, 1] - table[k, 1])) * float(job.unit[row])
            told = named(piece, origin, library, height)
        doubtful = kind != KINDS[HOLD].name and sure < settings.doubt
        pieces.append(replace(piece, doubtful=doubtful, **told))  # type: ignore[arg-type]
    return Draft(table, corners(table) | held, held, tuple(pieces))


def _free_holds(chain: Chain, pins: Mapping[int, Key]) -> Chain:
    """A hold between locked keys of different values is none."""
    kinds = chain.kinds.copy()
    for k in np.flatnonzero(kinds == HOLD).tolist():
        if k in pins or k + 1 in pins:
            kinds[k] = 0
    return Chain(chain.frames, kinds)
