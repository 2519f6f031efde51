"""A job's options: the command line's names; an unknown one is an error, never ignored."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from physretarget.errors import UsageError
from physretarget.options import JOBS, find
from physretarget.options.judging import JudgingOptions
from physretarget.service.errors import ApiError

_ABOUT_RULES = {"select", "ignore", "severity", "thresholds"}


def read_options(kind: str, text: str | None) -> dict[str, Any]:
    """The options as plain data, only those that were told.

    Raises:
        ApiError: 422, naming the option.
    """
    try:
        given = json.loads(text, parse_constant=_no_constant) if text else {}
    except (ValueError, RecursionError) as error:
        raise ApiError(422, "The options are not valid JSON.", field="options") from error
    if not isinstance(given, Mapping):
        raise ApiError(422, "The options are a JSON object.", field="options")
    options: dict[str, Any] = {}
    for name, value in given.items():
        try:
            found = find(name, JOBS[kind].api)
            if value is not None:
                options[found.name] = found.read(value, name)
        except UsageError as error:
            place = _plain(f"options.{name}")
            raise ApiError(422, _sentence(str(error)), field=place) from error
    if options.keys() & _ABOUT_RULES:
        _check_codes(options)
    return options


def _check_codes(options: Mapping[str, Any]) -> None:
    # The rules bring MuJoCo along, which the server needs for nothing else.
    from physretarget.validation import RULES, settings_of

    try:
        settings_of(options, RULES, JudgingOptions)
    except UsageError as error:
        raise ApiError(422, _sentence(str(error)), field="options") from error


def _sentence(text: str) -> str:
    return _plain(text[:1].upper() + text[1:], 1000)


def _plain(text: str, most: int = 200) -> str:
    """Text of a client that may hold anything, lone surrogates too."""
    return "".join(c if c.isprintable() else "_" for c in text)[:most]


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")
