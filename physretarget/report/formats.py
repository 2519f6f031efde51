"""A report, or many, in one of the text formats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from physretarget.errors import UsageError
from physretarget.options.judging import Severity
from physretarget.report.curation import render_csv, render_parquet, render_summary
from physretarget.report.json import render_json
from physretarget.report.junit import render_junit
from physretarget.report.markdown import render_markdown
from physretarget.report.sarif import render_sarif
from physretarget.report.text import render_text
from physretarget.validation import Report

FORMATS = ("text", "json", "sarif", "junit", "markdown", "csv", "parquet")


def render(
    reports: Report | Sequence[Report],
    format: str = "text",
    *,
    fail_on: Severity = "error",
    unread: Mapping[str, str] = MappingProxyType({}),
) -> bytes:
    """Render reports as one document that a parser of the format takes whole.

    Of several reports, JSON is an array; SARIF one run, because GitHub's code scanning refuses
    files whose runs share tool and category; JUnit a suite per clip; text a summary; CSV and
    Parquet a row per clip. HTML needs the poses: see ``render_html``.

    Args:
        reports: One report, or several.
        format: text, json, sarif, junit, markdown, csv or parquet.
        fail_on: What counts as a failed case in JUnit: error or warning.
        unread: Clips that could not be judged, and why. JSON and Markdown have no place for them.

    Returns:
        The document, UTF-8 where it is text.

    Raises:
        UsageError: There is no such format.
        MissingExtraError: Parquet without the extra ``parquet``.
    """
    match format:
        case "json":
            return render_json(reports).encode()
        case "sarif":
            return render_sarif(reports, unread=unread).encode()
        case "junit":
            return render_junit(reports, fail_on=fail_on, unread=unread).encode()
        case "markdown":
            return render_markdown(reports).encode()
        case "csv":
            return render_csv(reports, unread).encode()
        case "parquet":
            return render_parquet(reports, unread)
        case "text":
            if isinstance(reports, Report):
                return render_text(reports).encode()
            return render_summary(reports, unread).encode()
    raise UsageError(
        f"{format!r} is not a report format; these are: {', '.join(FORMATS)}. HTML is made by "
        "render_html, which needs the clip."
    )
