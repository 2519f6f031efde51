"""The morning report: a static site that needs neither a server nor a network.

Scripts, shapes and motions stand once in files of their own (as scripts, because a page opened
from disk may not fetch); pages are small and are only written again when they changed.
"""

from __future__ import annotations

import hashlib
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Any

from physretarget._version import __version__
from physretarget.files import write_file
from physretarget.suite.compare import VERDICTS, State
from physretarget.suite.environment import source, templates
from physretarget.suite.records import Accepted, Entry, Run
from physretarget.suite.store import Store
from physretarget.suite.summaries import (
    headline,
    in_order,
    render_data,
    render_junit,
    render_markdown,
)

_MANIFEST = "files.json"
_ASSETS = (
    "replay/assets/three.min.js", "replay/assets/clock.js", "replay/assets/stage.js",
    "replay/assets/player.js", "replay/assets/player.css", "assets/uPlot.iife.min.js",
    "assets/uPlot.min.css", "report/templates/report.css", "suite/templates/suite.css",
    "suite/templates/index.js", "suite/templates/clip.js",
)  # fmt: skip
_RUNS = 60  # nights in the trend
_FIRST = 8  # clips under "Open these first"
# Columns of the index beside errors and warnings: what people sort by.
_COLUMNS = {
    "unexplained_force_rms_bw": "unexplained force, BW",
    "skate_speed_max_m_s": "slide, m/s",
    "penetration_max_m": "penetration, m",
}


def write_site(store: Store, run: Run, entries: Sequence[Entry], out: Path) -> Path:
    """Write or update the site of a run; files of an earlier run that are no longer needed go.

    Returns:
        The index page.
    """
    site = _Site(out)
    accepted = store.baseline(run.suite)
    runs = [each for each in store.runs(run.suite, _RUNS) if each.id <= run.id]
    tracks = store.tracks([each.id for each in runs])
    states = store.states(
        {a for track in tracks.values() for _, a in track if a}
        | {e.baseline for e in entries if e.baseline}
    )
    pages = {entry.clip: f"clips/{_slug(entry.clip)}.html" for entry in entries}
    _write_assets(site)
    _write_motions(site, store, entries)
    _write_pages(site, store, entries, accepted, tracks, states, pages)
    _write_made(site, store, entries)
    ordered = in_order(entries)
    site.put("index.html", _index(run, runs, ordered, states, pages))
    site.put("data.json", render_data(run, ordered, states, pages))
    site.put("junit.xml", render_junit(run, entries))
    site.put("summary.md", render_markdown(run, entries, states))
    site.close()
    return out / "index.html"


class _Site:
    """A folder whose files we know: what we wrote once and no longer need is removed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            self.before: dict[str, str] = json.loads((folder / _MANIFEST).read_text())
        except (OSError, json.JSONDecodeError):
            self.before = {}
        self.now: dict[str, str] = {}

    def has(self, name: str, key: str) -> bool:
        """Whether the file is there from before, made from the same; it is then kept."""
        if self.before.get(name) != key or not (self.folder / name).is_file():
            return False
        self.now[name] = key
        return True

    def put(self, name: str, content: str | bytes, key: str = "") -> None:
        """Write a file."""
        data = content.encode() if isinstance(content, str) else content
        write_file(self.folder / name, data)
        self.now[name] = key

    def close(self) -> None:
        """Remove what is no longer needed and remember what is there."""
        for name in self.before.keys() - self.now.keys():
            # The list is ours, but somebody may have edited it: nothing outside is touched.
            target = (self.folder / name).resolve()
            if target.is_relative_to(self.folder.resolve()):
                target.unlink(missing_ok=True)
        write_file(self.folder / _MANIFEST, json.dumps(self.now, sort_keys=True).encode())


# ---- shared files ------------------------------------------------------------------------------


def _write_assets(site: _Site) -> None:
    # By path, not through their packages: those would load MuJoCo to hand over a text.
    package = resources.files("physretarget")
    for place in _ASSETS:
        text = package.joinpath(place).read_text("utf-8")
        name = f"assets/{place.rpartition('/')[2]}"
        key = _key(text)
        if not site.has(name, key):
            site.put(name, text, key)


def _write_motions(site: _Site, store: Store, entries: Sequence[Entry]) -> None:
    """Motions now and as accepted, where either is shown, and the models they need."""
    models: set[str] = set()
    addresses = {a for e in entries for a in (e.address, e.baseline) if a}
    for address in sorted(addresses):
        name = f"motion/{address}.js"
        # The key names the model, so that it is known without opening the motion.
        model = site.before.get(name, "")
        if not (model and site.has(name, model)):
            content = store.artifact(address, "motion")
            if content is None:
                continue  # could not be judged: there is nothing to show
            text = zlib.decompress(content).decode()
            model = str(json.loads(text)["model"])
            site.put(name, _script("motion", address, text), model)
        models.add(model)
    for model in sorted(models):
        name = f"models/{model}.js"
        if not site.has(name, "1"):
            content = store.artifact(model, "model")
            text = zlib.decompress(content).decode() if content else "null"
            site.put(name, _script("model", model, text), "1")


def _script(kind: str, key: str, text: str) -> str:
    """A JSON text as a script that hands it over; loading it from disk is allowed everywhere."""
    return f'physretargetData("{kind}", "{key}", {text});\n'


def _write_made(site: _Site, store: Store, entries: Sequence[Entry]) -> None:
    """Retargeted clips, to be taken from the report."""
    for entry in entries:
        if entry.kind != "retarget" or entry.address is None:
            continue
        name = f"made/{_slug(entry.clip)}.npz"
        if not site.has(name, entry.address):
            content = store.artifact(entry.address, "clip")
            if content is not None:
                site.put(name, content, entry.address)


# ---- clip pages --------------------------------------------------------------------------------

Track = Sequence[tuple[int, str | None]]


def _write_pages(
    site: _Site,
    store: Store,
    entries: Sequence[Entry],
    accepted: Mapping[str, Accepted],
    tracks: Mapping[str, Track],
    states: Mapping[str, State],
    pages: Mapping[str, str],
) -> None:
    stale: list[tuple[Entry, list[tuple[int, str | None]], str]] = []
    for entry in entries:
        steps = _steps(tracks.get(entry.clip, ()))
        known = accepted.get(entry.clip)
        key = _key([asdict(entry), steps, asdict(known) if known else None, __version__,
                    source("clip.html.j2")])  # fmt: skip
        if not site.has(pages[entry.clip], key):
            stale.append((entry, steps, key))
    if not stale:
        return
    from physretarget.suite.clip_page import clip_page

    documents = store.documents({a for e, _, _ in stale for a in (e.address, e.baseline) if a})
    for entry, steps, key in stale:
        made = f"../made/{_slug(entry.clip)}.npz"
        text = clip_page(entry, steps, accepted.get(entry.clip), documents, states, made)
        site.put(pages[entry.clip], text, key)


def _steps(track: Track) -> list[tuple[int, str | None]]:
    """The runs in which a clip's result changed: unchanged nights leave a page as it is."""
    return [each for i, each in enumerate(track) if i == 0 or each[1] != track[i - 1][1]]


# ---- the index ---------------------------------------------------------------------------------


def _index(
    run: Run,
    runs: Sequence[Run],
    entries: Sequence[Entry],
    states: Mapping[str, State],
    pages: Mapping[str, str],
) -> str:
    rows = [_row(entry, states.get(entry.address or ""), pages) for entry in entries]
    return templates().get_template("index.html.j2").render(
        version=__version__, run=run, when=run.finished.replace("T", " ").replace("+00:00", " UTC"),
        counts=[(v, run.counts.get(v, 0)) for v in VERDICTS], total=len(entries),
        head=headline(entries, states),
        first=[(e, pages[e.clip]) for e in entries if e.blocking][:_FIRST],
        trend=_trend(runs), columns=list(_COLUMNS.values()),
        cases=sorted({e.case_name for e in entries}),
        owners=sorted({e.owner for e in entries} - {""}),
        tags=sorted({tag for e in entries for tag in e.tags}),
        data={"rows": rows, "verdicts": VERDICTS},
    )  # fmt: skip


def _row(entry: Entry, state: State | None, pages: Mapping[str, str]) -> list[Any]:
    """A row of the index as a list: two thousand rows of names would be mostly names."""
    judged = state is not None and state.status == "ok"
    measures = state.measures if state else {}
    return [
        entry.verdict, entry.clip, pages[entry.clip], entry.case_name, entry.owner,
        list(entry.tags), state.errors if state and judged else None,
        state.warnings if state and judged else None, entry.reason, entry.blocking,
        [measures.get(name, {}).get("value") for name in _COLUMNS],
    ]  # fmt: skip


def _trend(runs: Sequence[Run]) -> dict[str, Any]:
    """Bars of the last runs: what was bad upward, what was good downward."""
    bad, good = ("errored", "worse", "missing"), ("fixed", "better")
    top = max((sum(r.counts.get(v, 0) for v in bad) for r in runs), default=0)
    low = max((sum(r.counts.get(v, 0) for v in good) for r in runs), default=0)
    scale = 44.0 / max(top, low, 1)
    bars: list[tuple[float, float, float, str]] = []
    for index, run in enumerate(runs):
        x, up, down = 8.0 * index + 1.0, 50.0, 50.0
        for verdict in bad:
            height = scale * run.counts.get(verdict, 0)
            up -= height
            bars.append((x, up, height, verdict))
        for verdict in good:
            height = scale * run.counts.get(verdict, 0)
            bars.append((x, down, height, verdict))
            down += height
    labels = [
        {"x": 8.0 * i, "text": f"run {r.id}, {r.finished[:16].replace('T', ' ')}: " + (
            ", ".join(f"{r.counts[v]} {v}" for v in VERDICTS if r.counts.get(v)))}
        for i, r in enumerate(runs)
    ]  # fmt: skip
    return {
        "bars": [bar for bar in bars if bar[2] > 0], "labels": labels, "top": top, "low": low,
        "width": 8 * max(len(runs), 20), "runs": len(runs),
    }  # fmt: skip


# ---- bits --------------------------------------------------------------------------------------


def _slug(clip: str) -> str:
    """A file name that reads like the clip and that no other clip has."""
    words = re.sub(r"[^A-Za-z0-9._-]+", "-", clip).strip("-.")[-80:]
    return f"{words}-{hashlib.sha256(clip.encode()).hexdigest()[:8]}"


def _key(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
