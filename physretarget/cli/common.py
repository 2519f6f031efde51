"""What every command shares: options from the schema, --quiet, --debug, progress, errors."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
import typer.core
from rich.console import Console

from physretarget.errors import UsageError
from physretarget.options import Option, Schema

Function = TypeVar("Function", bound=Callable[..., None])
Given = dict[str, Any]
"""The options of a schema that were typed, by name, checked; see :mod:`physretarget.options`."""

messages = Console(stderr=True, highlight=False, soft_wrap=True)
"""Where progress, notes and errors go; results go to stdout or to --out."""

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]

debug = False


_METAVARS = {"path": "PATH", "number": "NUMBER", "whole": "N", "text": "TEXT", "table": "TEXT"}


class _Command(typer.core.TyperCommand):
    """A command whose help names what to write: CLIP..., MODEL.xml, not types and braces."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """The command's line of usage."""
        options = [self.options_metavar] if self.options_metavar else []
        return [*options, *map(_shown, _arguments(self))]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The lists of arguments and options."""
        arguments = [
            (_shown(each), f"{each.help} [required]" if each.required else each.help)
            for each in _arguments(self)
        ]
        if arguments:
            with formatter.section("Arguments"):
                formatter.write_dl(arguments)
        options = [each for each in self.get_params(ctx) if each.param_type_name == "option"]
        with formatter.section("Options"):
            formatter.write_dl(filter(None, (each.get_help_record(ctx) for each in options)))


def _arguments(command: typer.core.TyperCommand) -> list[typer.core.TyperArgument]:
    return [each for each in command.params if isinstance(each, typer.core.TyperArgument)]


def _shown(argument: typer.core.TyperArgument) -> str:
    return argument.metavar or str(argument.name).upper()


def command(
    app: typer.Typer, name: str, schema: Schema | None = None, *, example: str
) -> Callable[[Function], Function]:
    """Register a function as a command with --quiet, --debug and an example in its help.

    With a ``schema`` it has the schema's options too; its function takes those that were typed as
    ``given``.
    """
    options = schema.command_line if schema else ()

    def register(function: Function) -> Function:
        signature = inspect.signature(function, eval_str=True)
        own = [
            parameter
            for parameter in signature.parameters.values()
            if parameter.annotation is not Given
        ]
        added = [
            inspect.Parameter(
                flag, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation
            )
            for flag, annotation in (("quiet", Quiet), ("debug", Debug))
        ]

        @functools.wraps(function)
        def run(**given: Any) -> None:
            global debug
            debug = given.pop("debug")
            messages.quiet = given.pop("quiet")
            if schema:
                given["given"] = _typed(given, options)
            function(**given)

        offered = [each for option in options for each in _parameters(option)]
        whole = signature.replace(parameters=[*own, *offered, *added])
        run.__signature__ = whole  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in whole.parameters.values()}
        app.command(name, cls=_Command, epilog=f"Example: {example}")(run)
        return function

    return register


def _parameters(option: Option) -> Iterator[inspect.Parameter]:
    """An option for Typer, under each of its names; all but the first work without being shown.

    Texts, as what is allowed is checked, and said, by the schema.
    """
    value: Any = bool if option.kind == "flag" else Path if option.kind == "path" else str
    default: Any = False if option.kind == "flag" else None
    if option.many or option.kind == "table":
        value, default = list[value], []
    elif option.kind != "flag":
        value |= None
    for name in option.names:
        told = typer.Option(
            flag_of(name),
            help=help_of(option),
            metavar=_metavar(option),
            show_default=False,
            hidden=name != option.name,
            autocompletion=_completion(option.choices),
        )
        yield inspect.Parameter(
            f"option_{name}",
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[value, told],
        )


def flag_of(name: str) -> str:
    """An option's name on the command line."""
    return "--" + name.replace("_", "-")


def help_of(option: Option) -> str:
    """An option's help with range and default, as the command line shows it."""
    return f"{option.help} [{option.facts}]" if option.facts else option.help


def _metavar(option: Option) -> str | None:
    if option.metavar or option.kind == "flag":
        return option.metavar or None
    if option.choices:
        return "|".join((*option.choices, *(("METRES",) if option.or_metres else ())))
    return option.unit.upper() or _METAVARS[option.kind]


def _typed(parameters: Given, options: Sequence[Option]) -> Given:
    """Take the options' texts out of what Typer has parsed; those that were typed, read."""
    found: Given = {}
    for option in options:
        texts = {
            name: text
            for name in option.names
            if (text := parameters.pop(f"option_{name}")) not in (None, False) and text != []
        }
        if len(texts) > 1:
            one, other, *_ = map(flag_of, texts)
            raise UsageError(f"{one} and {other} are the same: give one of them.")
        for name, text in texts.items():
            if option.kind in ("flag", "path"):
                found[option.name] = tuple(text) if option.many else text
            else:
                found[option.name] = option.parse(text, flag_of(name))
    for option in options:
        if option.required and option.name not in found:
            raise UsageError(f"{flag_of(option.name)} {_metavar(option)} is needed: {option.help}")
    return found


@contextmanager
def progress(what: str, steps: int | None = None) -> Iterator[Callable[[str], None]]:
    """A bar with the running stage's name on a terminal, nothing when piped.

    Calling what it yields begins the next of ``steps`` stages; the bar only pulses where their
    number is not known.
    """
    if not messages.is_terminal or messages.quiet:
        yield lambda stage: None
        return
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=messages, transient=True) as bar:
        task = bar.add_task(escape(what), total=steps)
        begun = 0

        def begin(stage: str) -> None:
            nonlocal begun
            bar.update(task, description=escape(f"{what}: {stage}"), completed=begun)
            begun += 1

        yield begin


def say(text: str) -> None:
    """A message for the person at the terminal (stderr)."""
    messages.print(text, markup=False)


def warn(text: str) -> None:
    """A doubt about the result, even under --quiet."""
    loud = Console(stderr=True, highlight=False, soft_wrap=True)
    loud.print("  [bold yellow]doubt[/]:", end=" ")
    loud.print(text, markup=False)


def fail(error: BaseException) -> None:
    """One sentence about what went wrong, even under --quiet."""
    loud = Console(stderr=True, highlight=False, soft_wrap=True)
    loud.print("[bold red]error[/]:", end=" ")
    loud.print(str(error), markup=False)


def _completion(values: Sequence[str]) -> Callable[[str], list[str]] | None:
    def begin(incomplete: str) -> list[str]:
        return [value for value in values if value.startswith(incomplete)]

    return begin if values else None


def complete(values: Sequence[str]) -> dict[str, Any]:
    """Metavar and tab completion for an option that takes one of these names."""
    return {"metavar": "|".join(values), "autocompletion": _completion(values)}


def one_of(value: str, values: Sequence[str], option: str) -> None:
    """Raise UsageError unless the value is one of those allowed."""
    if value not in values:
        raise UsageError(f"{option} is {value!r}; it must be one of {', '.join(values)}.")
