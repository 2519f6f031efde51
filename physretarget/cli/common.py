"""What every command shares: --quiet, --debug, progress on a terminal, one-sentence errors."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Annotated, Any, TypeVar

import typer
import typer.core
import typer.models
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from physretarget.errors import UsageError

Function = TypeVar("Function", bound=Callable[..., None])

messages = Console(stderr=True, highlight=False, soft_wrap=True)
"""Where progress, notes and errors go; results go to stdout or to --out."""

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]

debug = False


_PLACEHOLDERS = {"Path": "PATH", "float": "NUMBER", "int": "N", "str": "TEXT"}


class _Command(typer.core.TyperCommand):
    """A command whose help names what to write, not the Python types that it becomes."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        for parameter in self.params:
            if isinstance(parameter, typer.core.TyperArgument):
                # Its own name says what it is: CLIP..., MODEL.xml.
                parameter.display_type_rich = lambda ctx: None  # type: ignore[method-assign]
                if parameter.required:
                    setattr(parameter, "get_usage_pieces", partial(_name_alone, parameter))  # noqa: B010


def _name_alone(argument: typer.core.TyperArgument, _: object) -> list[str]:
    """For the usage line, where Typer would write {CLIP...}... of a required one."""
    return [argument.display_name_raw]


def _named(annotation: Any) -> Any:
    """An option without a metavar gets one after its type."""
    option = next(
        (m for m in getattr(annotation, "__metadata__", ()) if hasattr(m, "metavar")), None
    )
    if isinstance(option, typer.models.OptionInfo) and option.metavar is None:
        kinds = str(annotation.__origin__).replace("'", " ")
        for kind, placeholder in _PLACEHOLDERS.items():
            if re.search(rf"\b{kind}\b", kinds):
                option.metavar = placeholder
                break
    return annotation


def command(app: typer.Typer, name: str, *, example: str) -> Callable[[Function], Function]:
    """Register a function as a command with --quiet, --debug and an example in its help."""

    def register(function: Function) -> Function:
        signature = inspect.signature(function, eval_str=True)
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
            function(**given)

        own = [p.replace(annotation=_named(p.annotation)) for p in signature.parameters.values()]
        whole = signature.replace(parameters=[*own, *added])
        run.__signature__ = whole  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in whole.parameters.values()}
        app.command(name, cls=_Command, epilog=f"Example: {example}")(run)
        return function

    return register


@contextmanager
def progress(what: str, steps: int | None = None) -> Iterator[Callable[[str], None]]:
    """A bar with the running stage's name on a terminal, nothing when piped.

    Calling what it yields begins the next of ``steps`` stages; the bar only pulses where their
    number is not known.
    """
    if not messages.is_terminal or messages.quiet:
        yield lambda stage: None
        return
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


def fail(error: BaseException) -> None:
    """One sentence about what went wrong, even under --quiet."""
    loud = Console(stderr=True, highlight=False, soft_wrap=True)
    loud.print("[bold red]error[/]:", end=" ")
    loud.print(str(error), markup=False)


def complete(values: Sequence[str]) -> dict[str, Any]:
    """Metavar and tab completion for an option that takes one of these names."""
    return {
        "metavar": "|".join(values),
        "autocompletion": lambda incomplete: [v for v in values if v.startswith(incomplete)],
    }


def one_of(value: str, values: Sequence[str], option: str) -> None:
    """Raise UsageError unless the value is one of those allowed."""
    if value not in values:
        raise UsageError(f"{option} is {value!r}; it is one of {', '.join(values)}.")
