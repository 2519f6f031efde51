"""One HTML page of everything: figures, tables, film strips and a replay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from physretarget import __version__
from physretarget.mjcf import Character
from physretarget.replay.payload import payload, script_json
from physretarget.replay.scene import Scene
from physretarget.replay.web import asset, player_css, player_scripts
from physretarget.report.page import templates
from physretarget.report.stills import Row, stills
from physretarget.report.words import duration, number
from physretarget.reproduce import drawing, scenes, tables
from physretarget.reproduce.plan import STYLES, Take
from physretarget.reproduce.results import Results
from physretarget.reproduce.store import Piece
from physretarget.reproduce.studies import SHOWN_DIMS
from physretarget.reproduce.takes import STRIP

HERO = (("dance", "dance_a"), ("dance", "dance_b"), ("happy", "walk"), ("angry", "walk"))
FILM_ACTIONS = ("bow", "bye", "walk")
FIGURE_7 = ("happy", "walk")
CURVES = "walk"
WORDS = {
    "angry": "angry",
    "happy": "happy",
    "sad": "sad",
    "tired": "tired",
    "not-confident": "not confident",
    "normal": "normal",
    "dance": "dance",
}
SEARCHES = (("guided", "ours"), ("paper", "the paper's search"))


def render(results: Results) -> str:
    """The page as text; every value on it comes from the run's pieces."""
    characters = {
        name: Character.load(results.plan.models / f"{name}.xml")
        for name in results.plan.characters
    }
    heroes, strips = _heroes(results, characters), _strips(results, characters)
    shown = _representative(results)
    studies = results.studies
    cost = tables.cost(results)
    physics = tables.physics(results, characters)
    data = {
        "heroes": [payload(scene) for scene in heroes],
        "strips": [{"scene": payload(s["scene"]), "rows": s["rows"]} for s in strips],
    }
    context = {
        "title": "Animating Non-Humanoid Characters with Human Motion Data",
        "css": {
            "uplot": "",
            "player": player_css(),
            "report": Markup(_template_source("report.css")),
        },
        "scripts": (
            *player_scripts(),
            Markup(asset("filmstrip.js")),
            Markup(_template_source("yamane2010.js")),
        ),
        "data_json": Markup(script_json(data)),
        "version": __version__,
        "heroes": [scene.title for scene in heroes],
        "strips": strips,
        "number": number,
        "duration": duration,
        "words": WORDS,
        "notes": results.plan.notes,
        "table1": tables.table_1(results),
        "tiles": _tiles(results, physics, cost),
        "figure6": [
            (name, piece.facts["shown"], drawing.latent_maps(piece, SHOWN_DIMS, SEARCHES))
            for name, piece in list(studies["dimensions"].items())[:1]
        ],
        "dimension_curves": drawing.dimension_curves(studies["dimensions"]),
        "dimensions": studies["dimensions"],
        "iteration_curves": drawing.iteration_curves(studies["iterations"]),
        "figure8": drawing.momentum_curves(shown),
        "figure9": [
            (
                name,
                drawing.force_curves(
                    [(t.split(", ")[1], p) for t, p in shown if p.facts["character"] == name]
                ),
            )
            for name in characters
        ],
        "curves_of": CURVES,
        "momentum_worst": max(p.facts["momentum_error"] for p in results.takes.values()),
        "mapper_bars": drawing.error_bars(
            studies["mappers"],
            (("pose", "key pose"), ("take", "capture"), ("sequence", "sequence")),
        ),
        "mappers": tables.mappers(results),
        "losses": tables.losses(results),
        "fewer": tables.fewer(results),
        "reach": {name: piece.facts["cases"] for name, piece in studies["reach"].items()},
        "physics": physics,
        "cost": cost,
        "captures": _captures(results.plan.captures(), results),
    }
    return templates().get_template("yamane2010.html.j2").render(**context)


def _template_source(name: str) -> str:
    loader = templates().loader
    assert loader is not None
    return loader.get_source(templates(), name)[0]


def _tiles(results: Results, physics: Sequence[dict[str, Any]], cost: dict[str, Any]) -> list[Any]:
    """The page in a few numbers."""
    facts = [piece.facts for piece in results.takes.values()]
    frames = [f["frames"] for f in facts]
    before, after = (
        float(np.sqrt(np.average(np.square([f[k] for f in facts]), weights=frames)))
        for k in ("pull_before", "pull_after")
    )
    sequences = sum(row["style"] != "dance" for row in physics)
    sinks = sum(take["sinks"] for row in physics for take in row["takes"])
    skates = sum(take["skates"] for row in physics for take in row["takes"])
    clean = sum(f["errors"] == 0 for f in facts)

    def tile(label: str, value: str, unit: str, note: str, good: bool | None) -> dict[str, Any]:
        return {
            "label": label,
            "value": value,
            "unit": unit,
            "note": note,
            "good": good,
            "frame": None,
        }

    return [
        tile("Sequences", f"{sequences}", "", f"in {len(facts)} takes, dances included", None),
        tile("Animation", number(cost["animated"]), "s", "the paper made 418 s", None),
        tile(
            "Computing per second of animation",
            number(cost["per_second"]),
            "s",
            f"the paper's {number(cost['paper_per_second'])} s",
            cost["faster"] > 1,
        ),
        tile(
            "Vertical force that no floor could give",
            f"{before:.2f} → {after:.2f}",
            "BW RMS",
            "over all takes, before and after the paper's last stage",
            after < before,
        ),
        tile("Takes that sink over 1 cm", f"{sinks}", f"of {len(facts)}", "", sinks == 0),
        tile(
            "Takes whose planted points slide over 5 cm/s",
            f"{skates}",
            f"of {len(facts)}",
            "",
            skates == 0,
        ),
        tile("Takes without errors", f"{clean}", f"of {len(facts)}", "explained below", None),
    ]


def _find(results: Results, character: str, style: str, action: str) -> Piece | None:
    return results.takes.get(f"{character}/{style}/{action}")


def _heroes(results: Results, characters: dict[str, Character]) -> list[Scene]:
    found = []
    for style, action in HERO:
        pieces = {c: _find(results, c, style, action) for c in characters}
        known = {c: piece for c, piece in pieces.items() if piece is not None}
        if known:
            title = action.replace("_", " ") if style == "dance" else f"{WORDS[style]} {action}"
            found.append(scenes.together(title, known, characters))
    if not found:  # a run over a part of the captures shows what there is
        first = next(iter(results.takes.values()))
        name = str(first.facts["character"])
        found.append(
            scenes.together(str(first.facts["take"]), {name: first}, {name: characters[name]})
        )
    return found


def _strips(results: Results, characters: dict[str, Character]) -> list[dict[str, Any]]:
    """Figure 7 for every character, then all styles of an action beside each other."""
    found = []
    for name, character in characters.items():
        piece = _find(results, name, *FIGURE_7)
        if piece is None:
            continue
        rows, times = scenes.stages_of(results.out / "takes" / str(piece.facts["take"]), STRIP)
        labelled = [
            (label, None if label == "actor" else character, poses) for label, poses in rows
        ]
        found.append(
            _strip(f"{name}, {FIGURE_7[0]} {FIGURE_7[1]}", "stages", name, labelled, times)
        )
    for action in FILM_ACTIONS:
        shown: list[tuple[str, Character | None]] = [("actor", None), *characters.items()]
        for name, figure in shown:
            rows_of = []
            for style in STYLES:
                piece = _find(results, name if figure else next(iter(characters)), style, action)
                if piece is not None:
                    kind = "strip_qpos" if figure else "strip_actor"
                    rows_of.append((WORDS[style], figure, piece.arrays[kind]))
            if rows_of:
                found.append(_strip(f"{name}, {action}", "styles", name, rows_of, None))
    return found


def _strip(title: str, kind: str, name: str, rows: Any, times: Any) -> dict[str, Any]:
    scene = scenes.strip(title, rows, times)
    painted = stills(
        [
            Row(
                look=character.name if character else "actor",
                figure=figure,
                frames=np.arange(len(poses)),
            )
            for (_, character, poses), figure in zip(rows, scene.figures, strict=True)
        ]
    )
    return {
        "title": title,
        "kind": kind,
        "character": name,
        "scene": scene,
        "rows": [
            {"figure": k, "label": label, "note": "", "still": still}
            for k, ((label, _, _), still) in enumerate(zip(rows, painted, strict=True))
        ],
    }


def _representative(results: Results) -> list[tuple[str, Piece]]:
    """One take of every sequence for the curves: the walk, the hardest one, or the first."""
    found = []
    for (character, style), pieces in tables.sequences(results).items():
        piece = next((p for p in pieces if p.facts["action"] == CURVES), pieces[0])
        label = f"{WORDS[style]} {piece.facts['action'].replace('_', ' ')}"
        label = label.replace("dance dance", "dance")
        found.append((f"{character}, {label}", piece))
    return found


def _captures(takes: Sequence[Take], results: Results) -> list[dict[str, Any]]:
    return [
        {
            "name": take.capture.name,
            "sha256": results.takes[take.name].facts["capture_sha256"],
            "seconds": results.takes[take.name].facts["duration"],
        }
        for take in takes
    ]
