"""Every option is the same wherever it is offered: nothing here lists one by hand."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer
import typer.main
from typer.core import TyperOption

from physretarget import capture, clip, conversion, trained, validation
from physretarget.cli import app
from physretarget.errors import InputError, UsageError
from physretarget.face.match import MatchSettings
from physretarget.options import JOBS, SCHEMAS, Option, Schema, build, options_of
from physretarget.options.facial import MatchOptions
from physretarget.options.judging import ValidationOptions
from physretarget.options.motion import CaptureOptions, ClipOptions
from physretarget.options.retargeting import MapperOptions, RetargetSettings
from physretarget.suite.file import Case, load_suite

EVERY = [
    pytest.param(schema, option, id=f"{schema.name} {option.name}")
    for schema in SCHEMAS
    for option in schema.command_line
]
SENT = [
    pytest.param(schema, option, id=f"{kind} {option.name}")
    for kind, schema in JOBS.items()
    for option in schema.api
]
KEPT = [
    pytest.param(schema, option, id=f"{kind} {option.name}")
    for kind, schema in JOBS.items()
    for option in schema.suite
]


def sample(option: Option) -> Any:
    """A value that the option takes, as JSON and TOML have it, and not its default."""
    if option.kind == "table":
        last = option.choices[0] if option.choices else 0.5
        if option.keys:
            return {option.keys[0]: last}
        return {"DYN001": last if option.depth == 1 else {"error": last}}
    if option.span:
        return ["0.5:1.5"] if option.many else "0.5:1.5"
    if option.choices:
        value: Any = next(word for word in option.choices if word != option.default)
    else:
        low = option.least if option.above is None else option.above
        high = (low or 0.0) + 2 if option.most is None else option.most
        number = ((low or 0.0) + high) / 2
        value = {"number": number, "whole": int(number), "flag": True, "path": "some.file"}.get(
            option.kind, "DYN001"
        )
    return [value] if option.many else value


def typed(option: Option) -> str:
    """The same, as it is typed."""
    value = sample(option)
    if option.kind == "table":
        ((code, inner),) = value.items()
        return f"{code}={inner}" if option.depth == 1 else f"{code}.error={inner['error']}"
    return str(value[0] if option.many else value)


def beyond(option: Option) -> Iterator[Any]:
    """Values that the option must refuse."""
    yield {"a": []} if option.kind == "table" else [[]]
    if option.choices and not option.or_metres:
        yield "no such word"
    if option.most is not None:
        yield option.most * 2 + 1
    if option.above is not None or option.least is not None:
        yield -1


# ---- the command line --------------------------------------------------------------------------


def command_of(schema: Schema) -> Any:
    group: Any = typer.main.get_command(app)
    first, *rest = schema.name.split()
    command = group.load(first)
    for name in rest:
        command = command.commands[name]
    return command


@pytest.mark.parametrize(("schema", "option"), EVERY)
def test_the_command_line_offers_it(schema: Schema, option: Option) -> None:
    command = command_of(schema)
    offered = {flag: p for p in command.params if isinstance(p, TyperOption) for flag in p.opts}
    for name in option.names:
        found = offered["--" + name.replace("_", "-")]
        assert found.hidden == (name != option.name)
        assert found.is_flag == (option.kind == "flag")
        assert found.multiple == (option.many or option.kind == "table")
    shown = " ".join(" ".join(command.get_help(typer.Context(command)).split()).split("- "))
    for part in (option.help, option.range, option.default_words):
        assert " ".join(" ".join(part.split()).split("- ")) in shown


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.name)
def test_commands_have_no_options_of_their_own(schema: Schema) -> None:
    known = {"--" + n.replace("_", "-") for each in schema.command_line for n in each.names}
    known |= {"--quiet", "-q", "--debug"}
    offered = {
        flag for p in command_of(schema).params if isinstance(p, TyperOption) for flag in p.opts
    }
    assert offered == known


def _commands_with_a_model() -> Iterator[Any]:
    for schema in SCHEMAS:
        for option in schema.command_line:
            if {"model", "character"} & set(option.names):
                yield pytest.param(schema, option, id=schema.name)


@pytest.mark.parametrize(("schema", "option"), list(_commands_with_a_model()))
@pytest.mark.parametrize("name", ["model", "character"])
def test_the_model_goes_by_either_name(schema: Schema, option: Option, name: str) -> None:
    assert set(option.names) == {"model", "character"}
    command = command_of(schema)
    context = typer.Context(command, resilient_parsing=True)
    command.parse_args(context, [f"--{name}", "m.xml"])
    assert context.params[f"option_{name}"] == Path("m.xml")


# ---- the service -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def described() -> dict[str, Any]:
    from physretarget.service.forms import job_form

    content: dict[str, Any] = job_form()["properties"]["options"]["contentSchema"]
    return {each["title"]: each for each in content["anyOf"]}


@pytest.mark.parametrize(("schema", "option"), SENT)
def test_the_api_describes_and_takes_it(
    schema: Schema, option: Option, described: dict[str, Any]
) -> None:
    from physretarget.service.errors import ApiError
    from physretarget.service.options import read_options

    shown = described[schema.name]["properties"][option.name]
    assert option.help in shown["description"]
    assert option.range in shown["description"]
    assert option.default_words in shown["description"]
    value = sample(option)
    jsonschema.validate({option.name: value}, described[schema.name])
    got = read_options(schema.name, json.dumps({option.name: value}))
    assert got == {option.name: tuple(value) if option.many else value}
    for bad in beyond(option):
        text = json.dumps({option.name: bad})
        with pytest.raises(ApiError) as refused:
            read_options(schema.name, text)
        assert refused.value.field == f"options.{option.name}"
        assert "must be" in str(refused.value.message)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(json.loads(text), described[schema.name])


@pytest.mark.parametrize(("schema", "option"), SENT)
def test_the_web_form_is_told_of_it(schema: Schema, option: Option) -> None:
    from physretarget.service.routes_system import list_options

    shown = {each.name: each for each in list_options(None)[schema.name]}[option.name]  # type: ignore[arg-type]
    assert (shown.kind, shown.many, shown.choices) == (
        option.kind, option.many, list(option.choices)
    )  # fmt: skip
    assert (shown.least, shown.most, shown.above) == (option.least, option.most, option.above)
    assert (shown.help, shown.default) == (option.help, option.default_words)
    assert shown.label.endswith(option.unit)


# ---- the suite file ----------------------------------------------------------------------------


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + "}"
    return json.dumps(value)


def suite_case(folder: Path, kind: str, more: dict[str, Any]) -> Case:
    needed: dict[str, Any] = {
        "validate": {"clips": "a.npz", "model": "m.xml"},
        "retarget": {"captures": "a.bvh", "character": "c.xml", "keyposes": ["k.toml"]},
    }[kind]
    path = folder / "suite.toml"
    table = {"validate": "case", "retarget": "retarget"}[kind]
    lines = [f"{name} = {toml(value)}" for name, value in (needed | more).items()]
    path.write_text("\n".join([f"[[{table}]]", *lines]))
    (case,) = load_suite(path).cases
    return case


@pytest.mark.parametrize(("schema", "option"), KEPT)
def test_the_suite_file_takes_it(schema: Schema, option: Option, tmp_path: Path) -> None:
    value = sample(option)
    found = suite_case(tmp_path, schema.name, {option.name: value}).given[option.name]
    if option.kind == "path":
        value = [tmp_path / v for v in value] if option.many else tmp_path / value
    assert found == (tuple(value) if option.many else value)
    for bad in beyond(option):
        if isinstance(bad, object) and type(bad) is object:
            bad = [[]]
        with pytest.raises(InputError, match="must be") as refused:
            suite_case(tmp_path, schema.name, {option.name: bad})
        assert refused.value.line is not None


# ---- Python ------------------------------------------------------------------------------------

SETTINGS = {
    ValidationOptions: validation.Settings,
    MatchOptions: MatchSettings,
    RetargetSettings: RetargetSettings,
}
FUNCTIONS: dict[type, list[Callable[..., Any]]] = {
    ClipOptions: [clip.load_clip, clip.open_clip, conversion.convert],
    CaptureOptions: [capture.load],
    MapperOptions: [trained.learn],
}


@pytest.mark.parametrize("group", SETTINGS, ids=lambda group: group.__name__)
def test_settings_in_python_have_the_same_options(group: type) -> None:
    made = SETTINGS[group]
    defaults = {entry.name: entry.default for entry in fields(made)}
    for option in options_of(group):
        assert option in options_of(made)
        if option.kind != "table" and not option.word:
            assert defaults[option.field] == option.default
        for bad in beyond(option):
            if not option.word:
                with pytest.raises(UsageError, match=option.field):
                    made(**{option.field: bad})


@pytest.mark.parametrize("group", FUNCTIONS, ids=lambda group: group.__name__)
def test_functions_in_python_have_the_same_options(group: type) -> None:
    for function in FUNCTIONS[group]:
        taken = inspect.signature(function).parameters
        for option in options_of(group):
            assert taken[option.field].default == option.default


def test_all_surfaces_end_in_the_same_settings(tmp_path: Path) -> None:
    """One value of each option, typed, sent and written in a file."""
    from physretarget.service.options import read_options

    for kind, schema in JOBS.items():
        for group in schema.shared:
            for option in options_of(group):
                sent = read_options(kind, json.dumps({option.name: sample(option)}))
                written = suite_case(tmp_path, kind, {option.name: sample(option)}).given
                flag = "--" + option.name.replace("_", "-")
                flagged = option.kind == "flag"
                by_hand = {option.name: flagged or option.parse(typed(option), flag)}
                assert build(group, sent) == build(group, written) == build(group, by_hand)
                assert build(group, sent) != build(group, {}), option.name
