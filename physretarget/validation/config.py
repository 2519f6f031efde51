"""What a validation depends on besides clip and model: settings, and the TOML that sets them."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from physretarget.errors import InputError, UsageError
from physretarget.options import told
from physretarget.options.judging import JudgingOptions, Severity, ValidationOptions
from physretarget.validation.rule import Rule

# Beyond any unit; TOML knows whole numbers of any length.
_LARGEST = 1e15


@dataclass(frozen=True, kw_only=True)
class Settings(ValidationOptions):
    """How to judge.

    ``lowpass_hz`` filters the clip before anything is differentiated (None: not at all).
    ``contact_tolerance_m``: points this close to the floor touch; None: 3 % of the model's CoM
    height, at least 1 and at most 2 cm. ``friction`` overrides the model's. ``select`` and
    ``ignore`` are codes or their beginnings ("DYN"). ``limits`` maps a code to limit names to
    values, ``severity`` a code to its severity. ``stands``: a model fixed to the world only stands
    on its floor. ``simulate``: the clip is played forward too. ``also_literature`` adds other
    tools' numbers.
    """

    def chosen(self, rules: tuple[Rule, ...]) -> tuple[Rule, ...]:
        """The rules that are selected and not ignored.

        Args:
            rules: Rules to choose from.

        Returns:
            Those that apply, in order.
        """
        check_codes((*self.select, *self.ignore), rules)
        return tuple(
            rule
            for rule in rules
            if (self.simulate or rule.family != "SIM")
            and (not self.select or rule.code.startswith(self.select))
            and not (self.ignore and rule.code.startswith(self.ignore))
        )

    def limits_of(self, rule: Rule) -> Mapping[str, float]:
        """A rule's limits under this profile, overrides applied.

        An error told below the warning that was not told moves it down: a finding between the two
        would otherwise be neither.

        Args:
            rule: The rule.

        Returns:
            Name of the limit → value, in the limit's unit.
        """
        values = {name: limit.under(self.profile) for name, limit in rule.limits.items()}
        told = self.limits.get(rule.code, {})
        values |= told
        if "error" in told and "warning" not in told and "warning" in values:
            values["warning"] = min(values["warning"], values["error"])
        return values


def settings_of(
    given: Mapping[str, Any], rules: tuple[Rule, ...], group: type[JudgingOptions]
) -> Settings:
    """The settings of a config file, if there is one, with the options given over them.

    Args:
        given: options by name, as :mod:`physretarget.options` reads them; ``config`` is the file.
        rules: whose codes are valid.
        group: the options that are about judging; others of the same name are left alone.

    Returns:
        The settings.

    Raises:
        InputError: the file cannot be used.
        UsageError: a code or a limit that no rule has.
    """
    base = load_settings(given["config"], rules) if "config" in given else Settings()
    changes = told(group, given)
    limits = _limits(changes.get("limits", {}), rules)
    severity = _severity(changes.get("severity", {}), rules)
    changes |= {"limits": {**base.limits, **limits}, "severity": {**base.severity, **severity}}
    settings = replace(base, **changes)
    settings.chosen(rules)
    return settings


def check_codes(codes: tuple[str, ...], rules: tuple[Rule, ...]) -> None:
    """Raise UsageError for a code, or beginning of one, that no rule has."""
    known = [rule.code for rule in rules]
    for code in codes:
        if not code or not any(k.startswith(code) for k in known):
            raise UsageError(f"no rule has the code '{code}': " + _valid(code, known))


def load_settings(
    path: str | os.PathLike[str], rules: tuple[Rule, ...], base: Settings | None = None
) -> Settings:
    """Settings from a TOML file over ``base``.

    Keys: profile, lowpass_hz, contact_tolerance_m, friction, select, ignore, stands, and the tables
    [limits.CODE] name = value and [severity] CODE = "error" | "warning". Anything else is an
    InputError that lists what is valid.

    Args:
        path: The TOML file.
        rules: Rules that it may name.
        base: Settings that it changes.

    Returns:
        The settings.
    """
    source = Path(path)
    try:
        table = tomllib.loads(source.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=source) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is not valid TOML: {error}.", path=source) from error
    try:
        return _settings(table, rules, base or Settings())
    except UsageError as error:
        raise InputError(str(error), path=source) from error


def _settings(table: dict[str, Any], rules: tuple[Rule, ...], base: Settings) -> Settings:
    readers: dict[str, Callable[[str, Any], Any]] = {
        "profile": _text, "lowpass_hz": _number, "contact_tolerance_m": _number,
        "friction": _number, "select": _texts, "ignore": _texts,
        "also_literature": _flag, "stands": _flag,
    }  # fmt: skip
    known = [*readers, "limits", "severity"]
    for key in table:
        if key not in known:
            raise UsageError(f"unknown key '{key}': " + _valid(key, known))
    changes = {key: readers[key](key, table[key]) for key in readers if key in table}
    changes["limits"] = {**base.limits, **_limits(_table(table, "limits"), rules)}
    changes["severity"] = {**base.severity, **_severity(_table(table, "severity"), rules)}
    settings = replace(base, **changes)
    settings.chosen(rules)
    return settings


def _limits(table: dict[str, Any], rules: tuple[Rule, ...]) -> dict[str, dict[str, float]]:
    by_code = {rule.code: rule for rule in rules}
    read: dict[str, dict[str, float]] = {}
    for code, values in table.items():
        if code not in by_code:
            raise UsageError(f"no rule has the code '{code}': " + _valid(code, list(by_code)))
        if not isinstance(values, dict):
            raise UsageError(f"limits.{code} must be a table of names and numbers.")
        names = list(by_code[code].limits)
        for name, value in values.items():
            if name not in names:
                raise UsageError(f"{code} has no limit '{name}': " + _valid(name, names))
            number = _number(f"limits.{code}.{name}", value)
            if number < 0:
                raise UsageError(f"limits.{code}.{name} is {number:g}, 0 or more is needed.")
            read.setdefault(code, {})[name] = number
    return read


def _severity(table: dict[str, Any], rules: tuple[Rule, ...]) -> dict[str, Severity]:
    read: dict[str, Severity] = {}
    for code, value in table.items():
        check_codes((code,), rules)
        if value not in get_args(Severity):
            raise UsageError(f'severity.{code} is {value!r}: use "error" or "warning".')
        read[code] = value
    return read


def _table(table: dict[str, Any], name: str) -> dict[str, Any]:
    value = table.get(name, {})
    if not isinstance(value, dict):
        raise UsageError(f"'{name}' must be a table.")
    return value


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise UsageError(f"'{name}' must be a text.")
    return value


def _texts(name: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        raise UsageError(f"'{name}' must be a list of codes.")
    return tuple(value)


def _number(name: str, value: Any) -> float:
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not plain or not abs(value) <= _LARGEST:
        raise UsageError(f"'{name}' must be a number, at most {_LARGEST:g}.")
    return float(value)


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise UsageError(f"'{name}' must be true or false.")
    return value


def _valid(given: str, names: list[str]) -> str:
    close = get_close_matches(given, names, n=1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    return f"{hint}valid are {', '.join(names)}."
