"""What machines and pull requests read of a run: JUnit, Markdown, data.json."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from xml.etree import ElementTree as Xml

from physretarget.report.words import count
from physretarget.suite.compare import VERDICTS, State
from physretarget.suite.records import Entry, Run

SCHEMA = "physretarget/suite/1"
_SHOWN = 50
_TONE = {"bad": "❌", "open": "🟡", "ok": "✅"}
_MARK = {
    "errored": "💥", "worse": "🔴", "missing": "❓", "fixed": "✅", "better": "🟢", "new": "🆕",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Headline:
    """A run in a line: what its clips are worth before what changed.

    Attributes:
        tone: ``bad`` where something got worse, ``open`` where nothing was accepted to compare with
            or clips fail that were accepted so, ``ok`` where all is well.
        title: what to do, or that there is nothing.
        change: what changed, in two or three words.
        verdicts: clips by verdict: failed, not judged, errored, passed; those that occur.
    """

    tone: Literal["bad", "open", "ok"]
    title: str
    change: str
    verdicts: tuple[tuple[str, int], ...]

    @property
    def counts(self) -> str:
        """The verdicts in words."""
        return ", ".join(f"{number} {verdict}" for verdict, number in self.verdicts)


def headline(entries: Sequence[Entry], states: Mapping[str, State]) -> Headline:
    """What a curator reads first."""
    counts: Counter[str] = Counter()
    for entry in entries:
        state = states.get(entry.address or "")
        if state is not None:
            counts[state.judgement if state.status == "ok" else "errored"] += 1
    order = ("failed", "not judged", "errored", "passed")
    verdicts = tuple((verdict, counts[verdict]) for verdict in order if counts[verdict])
    blocking = sum(entry.blocking for entry in entries)
    failing = counts["failed"] + counts["errored"]
    known = [entry for entry in entries if entry.baseline is not None]
    if blocking:
        title = f"{count(blocking, 'clip')} to look at"
        return Headline(tone="bad", title=title, change="regressions", verdicts=verdicts)
    if not known:
        title = f"{count(len(entries), 'clip')}, none accepted yet"
        return Headline(
            tone="open", title=title, change="nothing to compare with", verdicts=verdicts
        )
    if failing:
        title = f"Nothing got worse, but {count(failing, 'clip')} fail"
        title += "s" if failing == 1 else ""
        return Headline(tone="open", title=title, change="no regressions", verdicts=verdicts)
    return Headline(
        tone="ok", title="Nothing got worse", change="no regressions", verdicts=verdicts
    )


def render_junit(run: Run, entries: Sequence[Entry]) -> str:
    """A suite per case, a test per clip; it fails exactly where the exit code is due to it."""
    root = Xml.Element("testsuites", name=_clean(run.suite))
    for case in sorted({entry.case_name for entry in entries}):
        mine = [entry for entry in entries if entry.case_name == case]
        suite = Xml.SubElement(root, "testsuite", name=_clean(case), tests=str(len(mine)))
        for entry in mine:
            test = Xml.SubElement(
                suite, "testcase", classname=_clean(case), name=_clean(entry.clip)
            )
            text = _clean(f"{entry.verdict}: {entry.reason}")
            if entry.blocking:
                kind = "error" if entry.verdict == "errored" else "failure"
                Xml.SubElement(test, kind, type=entry.verdict, message=text)
            elif entry.verdict == "errored":
                Xml.SubElement(test, "skipped", message=text)
            else:
                Xml.SubElement(test, "system-out").text = text
        blocking = [entry for entry in mine if entry.blocking]
        errors = sum(entry.verdict == "errored" for entry in blocking)
        skipped = sum(entry.verdict == "errored" for entry in mine) - errors
        suite.set("failures", str(len(blocking) - errors))
        suite.set("errors", str(errors))
        suite.set("skipped", str(skipped))
    Xml.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + Xml.tostring(root, encoding="unicode") + "\n"


def render_markdown(run: Run, entries: Sequence[Entry], states: Mapping[str, State]) -> str:
    """Verdicts, then every clip that changed, the worst first."""
    head = headline(entries, states)
    lines = [
        f"### {_cell(run.suite)}, run {run.id}: {_TONE[head.tone]} {head.title}",
        "",
        f"{head.counts}." if head.verdicts else "No clip was judged.",
        "",
        f"{len(entries)} clips in {run.seconds:.0f} s, {run.done} judged anew: "
        + ", ".join(f"{run.counts[v]} {v}" for v in VERDICTS if run.counts.get(v))
        + ".",
    ]
    changed = in_order(entry for entry in entries if entry.verdict not in ("same", "new"))
    if changed:
        lines += ["", "| | clip | owner | what |", "|---|---|---|---|"]
        lines += [
            f"| {_MARK[e.verdict]} {e.verdict} | `{_cell(e.clip)}` | {_cell(e.owner)} "
            f"| {_cell(e.reason)} |"
            for e in changed[:_SHOWN]
        ]
    if len(changed) > _SHOWN:
        lines += ["", f"And {len(changed) - _SHOWN} more in the report."]
    return "\n".join(lines) + "\n"


def render_data(
    run: Run, entries: Sequence[Entry], states: Mapping[str, State], pages: Mapping[str, str]
) -> str:
    """Everything as JSON: schema ``physretarget/suite/1``, clips in the order of the report."""
    document = {
        "schema": SCHEMA,
        "suite": run.suite,
        "run": {
            "id": run.id, "started": run.started, "finished": run.finished,
            "seconds": round(run.seconds, 3), "version": run.version, "judged_anew": run.done,
        },
        "verdicts": dict(headline(entries, states).verdicts),
        "counts": {verdict: run.counts.get(verdict, 0) for verdict in VERDICTS},
        "blocking": sum(entry.blocking for entry in entries),
        "clips": [_clip(entry, states.get(entry.address or ""), pages) for entry in entries],
    }  # fmt: skip
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _clip(entry: Entry, state: State | None, pages: Mapping[str, str]) -> dict[str, Any]:
    judged = state is not None and state.status == "ok"
    return {
        "clip": entry.clip, "case": entry.case_name, "kind": entry.kind,
        "tags": list(entry.tags), "owner": entry.owner, "verdict": entry.verdict,
        "reason": entry.reason, "blocking": entry.blocking,
        "changes": [dict(change) for change in entry.changes],
        "passed": state.passed if state and judged else None,
        "judgement": state.judgement if state and judged else None,
        "errors": state.errors if state and judged else None,
        "warnings": state.warnings if state and judged else None,
        "measures": {n: m["value"] for n, m in state.measures.items()} if state else {},
        "address": entry.address, "baseline": entry.baseline, "page": pages.get(entry.clip),
    }  # fmt: skip


def in_order(entries: Iterable[Entry]) -> list[Entry]:
    """The worst first: what blocks, then by verdict, then by name."""
    rank: dict[str, int] = {verdict: index for index, verdict in enumerate(VERDICTS)}
    return sorted(entries, key=lambda e: (not e.blocking, rank.get(e.verdict, 99), e.clip))


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("`", "'").split())


def _clean(text: str) -> str:
    """Text without the control characters that XML forbids."""
    return "".join(c for c in text if c in "\t\n" or ord(c) >= 32)
