"""A report as JSON, and the schema it keeps."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from physretarget.validation.report import Report


def render_json(reports: Report | Sequence[Report]) -> str:
    """The JSON document of interface ``physretarget/report/1``, keys in a fixed order.

    Of a sequence an array of such documents, also where it has one report or none.
    """
    if isinstance(reports, Report):
        document: object = reports.to_dict()
    else:
        document = [report.to_dict() for report in reports]
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


@cache
def schema() -> dict[str, Any]:
    """The JSON Schema of one report by :func:`render_json`, as shipped with the package."""
    text = files("physretarget.report").joinpath("schema.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded
