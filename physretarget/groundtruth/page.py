"""The page about ground truth: everything on it is computed here from the folder's trials."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from physretarget.files import write_file
from physretarget.groundtruth import figures
from physretarget.groundtruth.compare import Comparison, compare
from physretarget.groundtruth.contacts import ContactTiming, contact_timing
from physretarget.groundtruth.coverage import LOADED, MARGIN, Coverage, coverage
from physretarget.groundtruth.explain import Unexplained, by_fitted_forces, by_measured_forces
from physretarget.groundtruth.feet import FootAgreement, foot_agreement
from physretarget.groundtruth.trial import GRAVITY, Trial
from physretarget.kinetics import DEFAULT_HZ as FORCES_HZ

DEFAULT_HZ = 6.0
_FINDINGS = re.compile(r"<!-- findings:[^>]*-->(.*?)<!-- end of findings -->", re.DOTALL)
FILTERS = (3.0, 4.5, 6.0, 8.0, 10.0, 12.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """All figures of one trial."""

    trial: Trial
    covered: Coverage
    by_hz: dict[float, Comparison]
    measured: Unexplained
    fitted: Unexplained
    contacts: ContactTiming
    feet: FootAgreement | None

    def at(self, hz: float) -> Comparison:
        """The comparison at one filter."""
        return self.by_hz[hz]


def judge(trial: Trial, *, hz: float = DEFAULT_HZ) -> Judged:
    """Compute everything that the page shows of a trial."""
    covered = coverage(trial)
    return Judged(
        trial=trial,
        covered=covered,
        by_hz={each: compare(trial, covered, hz=each) for each in sorted({*FILTERS, hz})},
        measured=by_measured_forces(trial, covered, hz=hz),
        fitted=by_fitted_forces(trial, covered, hz=hz),
        contacts=contact_timing(trial, covered),
        feet=foot_agreement(trial, covered),
    )


def write_page(
    trials: Sequence[Trial],
    page: str | Path,
    *,
    others: Sequence[Trial] = (),
    hz: float = DEFAULT_HZ,
) -> None:
    """Write the page, and its pictures into the folder ``images`` beside it.

    ``others`` are trials of other bodies and laboratories, in a table of their own.
    """
    page = Path(page)
    judged = [judge(trial, hz=hz) for trial in sorted(trials, key=lambda trial: trial.name)]
    comparisons = [one.at(hz) for one in judged]
    moving = [one for one in comparisons if one.vertical.r is not None]
    striding = sorted(moving, key=lambda one: -(one.forward.r or 0.0))[:3]
    images = page.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    pictures = {
        "ground-truth-vertical.png": figures.vertical(moving),
        "ground-truth-horizontal.png": figures.horizontal(
            sorted(striding, key=lambda one: one.name)
        ),
        "ground-truth-filter.png": figures.filters(
            {
                one.trial.name: [
                    (each, one.at(each).vertical.rmse, one.at(each).vertical.r) for each in FILTERS
                ]
                for one in judged
            }
        ),
    }
    for name, content in pictures.items():
        write_file(images / name, content)
    further = [judge(trial, hz=hz) for trial in others]
    text = render(judged, others=further, hz=hz, findings=_findings(page))
    write_file(page, text.encode("utf-8"))


def _findings(page: Path) -> str:
    """What people wrote into the page about its figures; a new page has nothing yet."""
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    kept = _FINDINGS.search(text)
    return kept[1].strip() if kept else "Nothing has been written about these trials yet."


def render(
    judged: Sequence[Judged], *, others: Sequence[Judged] = (), hz: float, findings: str
) -> str:
    """The page's Markdown; ``findings`` is the section written by hand."""
    environment = Environment(
        loader=PackageLoader("physretarget.groundtruth", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # Markdown
    )
    environment.filters["f"] = _number
    environment.filters["ms"] = _milliseconds
    return environment.get_template("page.md.j2").render(
        judged=list(judged), others=list(others), hz=hz, findings=findings,
        filters=FILTERS, forces_hz=FORCES_HZ, loaded=LOADED, margin=MARGIN,
        weight=judged[0].trial.weight, mass=judged[0].trial.weight / GRAVITY,
    )  # fmt: skip


def _number(value: float | None, digits: int = 3, sign: bool = False) -> str:
    """A rounded number, a dash for none; never "-0.000"."""
    if value is None or np.isnan(value):
        return "–"
    rounded = round(float(value), digits) + 0.0
    return f"{rounded:+.{digits}f}" if sign else f"{rounded:.{digits}f}"


def _milliseconds(errors: Sequence[float]) -> str:
    return ", ".join(f"{round(1000 * error):+d}" for error in errors) or "–"
