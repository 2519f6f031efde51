"""One option: its declaration in a settings class, what it allows, and how it is read."""

from __future__ import annotations

import math
import types
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from physretarget.errors import UsageError

Kind = Literal["flag", "number", "whole", "text", "path", "table"]
Group = TypeVar("Group")

_KINDS: Mapping[Any, Kind] = {
    bool: "flag", float: "number", int: "whole", str: "text", Path: "path",
}  # fmt: skip
_NOUNS: Mapping[Kind, str] = {
    "flag": "true or false", "number": "a number", "whole": "a whole number", "text": "a text",
    "path": "a path", "table": "a table",
}  # fmt: skip
_JSON_TYPES: Mapping[Kind, str] = {
    "flag": "boolean", "number": "number", "whole": "integer", "text": "string", "path": "string",
    "table": "number",
}  # fmt: skip
_FORM = (
    "name", "kind", "many", "depth", "help", "least", "most", "above", "advanced", "or_metres",
    "metavar",
)  # fmt: skip
_LONGEST = 4096  # characters of a text that is read


@dataclass(frozen=True, kw_only=True)
class Option:
    """What every surface needs to know of an option; made by :func:`options_of`.

    Attributes:
        help: one or two sentences, without default and range, which are appended.
        name: as it is written: ``joint_order`` in files and JSON, ``--joint-order`` on the
            command line.
        field: the attribute of its settings class.
        kind: type of one value.
        many: takes several values.
        depth: of a table: 1 for ``{CODE: value}``, 2 for ``{CODE: {name: value}}``.
        default: the value where none is given; None: see ``default_text``. MISSING: required.
        unit: of a number.
        choices: the words allowed.
        or_metres: a text may also be a number written out, metres per unit.
        or_file: a text may also be a file with this ending (where files can be given).
        least, most, above: bounds of a number, ``above`` is not allowed itself.
        zero_for_none: 0 switches it off.
        keys: those that a table may have; any where there are none.
        span: a text is two times in s with a colon in between.
        word: of a flag that is written as a word, as in ``--also literature``.
        default_text: in words, what is taken where the default is None.
        aliases: names that are accepted besides.
        metavar: what stands for the value in the help of the command line.
        advanced: folded away in the web form.
        label: in the web form.
    """

    help: str
    name: str = ""
    field: str = ""
    kind: Kind = "text"
    many: bool = False
    depth: int = 0
    default: Any = MISSING
    unit: str = ""
    choices: tuple[str, ...] = ()
    or_metres: bool = False
    or_file: str = ""
    least: float | None = None
    most: float | None = None
    above: float | None = None
    zero_for_none: bool = False
    keys: tuple[str, ...] = ()
    span: bool = False
    word: str = ""
    default_text: str = ""
    aliases: tuple[str, ...] = ()
    metavar: str = ""
    advanced: bool = False
    label: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """All names that are accepted, the documented one first."""
        return self.name, *self.aliases

    @property
    def required(self) -> bool:
        """Whether a value must be given."""
        return self.default is MISSING

    @cached_property
    def range(self) -> str:
        """What a number may be, in words: "0 to 1000 Hz"; empty where any will do."""
        unit = f" {self.unit}" if self.unit else ""
        most = "" if self.most is None else f"{_short(self.most)}{unit}"
        if self.above is not None and not self.zero_for_none:
            return f"above {_short(self.above)}" + (f" and at most {most}" if most else unit)
        least = self.least if self.above is None else 0.0
        if least is not None:
            return f"{_short(least)} to {most}" if most else f"{_short(least)}{unit} or more"
        return f"at most {most}" if most else ""

    @cached_property
    def allowed(self) -> str:
        """What a value may be, in words that follow "it must be"."""
        if self.choices and self.kind != "table":
            words = ", ".join(self.choices)
            if self.or_metres:
                return f"one of {words}, or metres per unit as a number"
            if self.or_file:
                return f"one of {words}, or a file that ends in {self.or_file}"
            return f"one of {words}" if len(self.choices) > 1 else words
        if self.kind == "table":
            if self.keys:
                return f"NAME=number {self.range}, NAME one of {', '.join(self.keys)}"
            last = " or ".join(self.choices) if self.choices else "number"
            return f"CODE{'.NAME' if self.depth == 2 else ''}={last}"
        if self.span:
            return "two times in seconds, the earlier one first, as in 2.0:3.5"
        bounds = self.range
        if bounds and not bounds.startswith(("above", "at most")):
            bounds = f"of {bounds}" if "or more" in bounds else f"from {bounds}"
        return " ".join(filter(None, (_NOUNS[self.kind], bounds)))

    @cached_property
    def default_words(self) -> str:
        """What is taken where nothing is given, in words; empty where that is nothing."""
        if self.default_text or self.required or self.kind in ("flag", "table"):
            return self.default_text
        if self.default is None or self.default == ():
            return ""
        number = isinstance(self.default, (int, float))
        return _short(self.default) if number else str(self.default)

    @property
    def facts(self) -> str:
        """Range, default and whether it is required, in words, to follow the help."""
        default = self.default_words and f"default: {self.default_words}"
        return "; ".join(filter(None, (self.range, default, "required" if self.required else "")))

    def read(self, value: Any, said: str = "") -> Any:
        """A value from a file or a program, checked.

        Args:
            value: as TOML or JSON have it.
            said: how to name the option in an error; its name if empty.

        Returns:
            The value; a tuple of a ``many`` option, for which one value alone will do too.

        Raises:
            UsageError: one sentence with what was given and what is allowed.
        """
        said = said or self.name
        if not self.many:
            return self._read(value, said)
        several = value if isinstance(value, (list, tuple)) else [value]
        return tuple(self._read(each, said) for each in several)

    def parse(self, texts: str | Iterable[str], said: str = "") -> Any:
        """A value from texts, as the command line and web forms have them; else as :meth:`read`."""
        said = said or self.name
        given = [texts] if isinstance(texts, str) else list(texts)
        if self.kind == "table":
            return self._read(self._table_of(given, said), said)
        if self.many and self.kind != "path":
            given = [part for text in given for part in text.replace(",", " ").split()]
        values = tuple(self._read(self._value_of(text), said) for text in given)
        return values if self.many else values[-1]

    def setting(self, value: Any) -> Any:
        """A value that was read, as its settings class holds it."""
        if self.word:
            return value == self.word
        return None if self.zero_for_none and value == 0 else value

    def json_schema(self) -> dict[str, Any]:
        """The option as JSON Schema, for the description of an API."""
        one: dict[str, Any] = {"type": "string" if self.choices else _JSON_TYPES[self.kind]}
        if self.choices:
            one["enum"] = list(self.choices)
        for key, bound in (("minimum", self.least), ("maximum", self.most)):
            if bound is not None:
                one[key] = bound
        if self.above is not None:
            one["minimum" if self.zero_for_none else "exclusiveMinimum"] = self.above
        if self.or_metres:
            one = {"anyOf": [one, {"type": "string", "description": "Metres per unit."}]}
        for _ in range(self.depth):
            one = {"type": "object", "additionalProperties": one}
        if self.keys:
            one["propertyNames"] = {"enum": list(self.keys)}
        if self.many:
            one = {"type": "array", "items": one}
        described = {"description": f"{self.help} [{self.facts}]" if self.facts else self.help}
        if not self.required and self.default not in (None, ()) and self.kind != "table":
            described["default"] = self.default
        return one | described

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a form in a browser."""
        told = {name: getattr(self, name) for name in _FORM}
        named = self.label or self.name.replace("_", " ").capitalize()
        label = f"{named}, {self.unit}" if self.unit else named
        return told | {"choices": list(self.choices), "label": label, "default": self.default_words}

    def _value_of(self, text: str) -> Any:
        """A number where one is meant; whatever is none is refused when it is read."""
        if self.kind == "whole":
            return _number(text, int)
        return _number(text, float) if self.kind == "number" else text

    def _table_of(self, texts: list[str], said: str) -> dict[str, Any]:
        table: dict[str, Any] = {}
        for entry in (part for text in texts for part in text.replace(",", " ").split()):
            path, equals, text = entry.partition("=")
            keys = path.split(".")
            if not equals or len(keys) != self.depth or not all(keys):
                raise UsageError(f"{said} is {entry!r}; it must be {self.allowed}.")
            place = table.setdefault(keys[0], {}) if self.depth == 2 else table
            place[keys[-1]] = text if self.choices else _number(text, float)
        return table

    def _read(self, value: Any, said: str) -> Any:
        if self.kind == "table":
            return self._read_table(value, said, self.depth)
        if (good := self._plain(value)) is None:
            raise self._refusal(value, said)
        if self.kind in ("number", "whole"):
            self._check_bounds(good, said)
        if self.span and not _is_span(good):
            raise self._refusal(value, said)
        if self.choices and good not in self.choices and not self._otherwise(good):
            raise self._refusal(value, said)
        return good

    def _plain(self, value: Any) -> Any:
        """The value in its own type; None if it has another."""
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        match self.kind:
            case "flag":
                return value if isinstance(value, bool) else None
            case "number":
                return float(value) if number and math.isfinite(value) else None
            case "whole":
                return value if number and isinstance(value, int) else None
            case "path":
                return Path(value) if isinstance(value, (str, Path)) and str(value) else None
        if self.or_metres and number:
            return f"{value:g}"
        good = isinstance(value, str) and (self.many or value) and len(value) <= _LONGEST
        return value if good else None

    def _otherwise(self, text: str) -> bool:
        """Whether a word that is no choice is what may stand in for one."""
        if self.or_metres:
            number = _number(text, float)
            return isinstance(number, float) and 1e-6 <= number <= 1e3
        return bool(self.or_file) and text.lower().endswith(self.or_file)

    def _check_bounds(self, value: float, said: str) -> None:
        low = (self.least is not None and value < self.least) or (
            self.above is not None
            and not (value > self.above or (self.zero_for_none and value == 0))
        )
        if low or (self.most is not None and value > self.most):
            raise self._refusal(value, said)

    def _read_table(self, value: Any, said: str, depth: int) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not all(map(_is_key, value)):
            raise self._refusal(value, said)
        if depth == 2:
            return {k: self._read_table(v, f"{said}.{k}", 1) for k, v in value.items()}
        for key, each in value.items():
            number = isinstance(each, (int, float)) and not isinstance(each, bool)
            good = each in self.choices if self.choices else number and math.isfinite(each)
            if self.keys and key not in self.keys:
                raise UsageError(f"{said} names {_shown(key)}; it must be {self.allowed}.")
            if good and not self.choices:
                self._check_bounds(each, f"{said}.{key}")
            if not good:
                allowed = f"one of {', '.join(self.choices)}" if self.choices else "a number"
                raise UsageError(f"{said}.{key} is {_shown(each)}; it must be {allowed}.")
        return dict(value)

    def _refusal(self, value: Any, said: str) -> UsageError:
        return UsageError(f"{said} is {_shown(value)}; it must be {self.allowed}.")


def _is_key(key: object) -> bool:
    """Whether a table's key may be a code or a limit's name; which there are is known elsewhere."""
    return isinstance(key, str) and key.isascii() and key.isidentifier() and len(key) <= 80


def _is_span(text: str) -> bool:
    """Whether a text is two times, the earlier one first."""
    times = [_number(part, float) for part in text.split(":")]
    good = len(times) == 2 and all(isinstance(t, float) and 0 <= t < math.inf for t in times)
    return bool(good and times[0] < times[1])


def _short(number: float) -> str:
    """A number without what says nothing: 6, 0.5, 2147483647."""
    return str(int(number)) if number == int(number) else f"{number:g}"


def _number(text: str, kind: type[int] | type[float]) -> Any:
    try:
        return kind(text)
    except ValueError:
        return text


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return _short(value) if math.isfinite(value) else str(value)
    text = repr(str(value) if isinstance(value, Path) else value)
    return text if len(text) <= 100 else f"{text[:97]}…"


def option(default: Any = MISSING, *, help: str, **more: Any) -> Any:
    """Declare an option as the default of a dataclass's field.

    Args:
        default: see :class:`Option`; required without.
        help: see :class:`Option`.
        more: other attributes of :class:`Option`. Type, several values and (of a Literal) choices
            come from the field's annotation.
    """
    metadata = {"option": Option(help=help, default=default, **more)}
    if isinstance(default, Mapping):
        return field(default_factory=lambda: dict(default), metadata=metadata)
    return field(default=default, metadata=metadata)


@cache
def options_of(group: type) -> tuple[Option, ...]:
    """The options that a settings class declares, in its order."""
    hints = get_type_hints(group)
    return tuple(
        _made(entry, hints[entry.name]) for entry in fields(group) if "option" in entry.metadata
    )


def _made(entry: Field[Any], hint: Any) -> Option:
    told: Option = entry.metadata["option"]
    if get_origin(hint) in (Union, types.UnionType):
        hint = next(each for each in get_args(hint) if each is not type(None))
    many, depth, choices, default = get_origin(hint) is tuple, 0, told.choices, told.default
    if many:
        hint = get_args(hint)[0]
    while get_origin(hint) is Mapping:
        hint, depth = get_args(hint)[1], depth + 1
    if told.word:
        choices, hint, default = (told.word,), str, None
    if get_origin(hint) is Literal:
        choices, hint = get_args(hint), str
    return replace(
        told, name=told.name or entry.name, field=entry.name, many=many, depth=depth,
        kind="table" if depth else _KINDS[hint], choices=choices, default=default,
    )  # fmt: skip


def check(settings: Any) -> None:
    """Raise UsageError for the first option of a settings object that holds what is not allowed.

    For ``__post_init__``.
    """
    group: type = type(settings)
    for each in options_of(group):
        value = getattr(settings, each.field)
        if (value is None and each.default is None) or each.word:
            continue
        if each.zero_for_none and (value is None or value == 0):
            if value is None:
                continue
            raise UsageError(f"{each.field} is 0; it must be {each.allowed}, or None.")
        each.read(value, each.field)


def build(group: type[Group], given: Mapping[str, Any], **more: Any) -> Group:
    """A settings object from options by name; those that it does not have are left alone."""
    return group(**told(group, given), **more)


def told(group: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the given options that a settings class has, by its fields, as it wants them."""
    return {
        each.field: each.setting(given[each.name])
        for each in options_of(group)
        if given.get(each.name) is not None
    }
