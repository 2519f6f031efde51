"""What every command shares: --quiet, --debug, progress on a terminal, one-sentence errors."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar

import typer
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

        whole = signature.replace(parameters=[*signature.parameters.values(), *added])
        run.__signature__ = whole  # type: ignore[attr-defined]
        run.__annotations__ = {p.name: p.annotation for p in whole.parameters.values()}
        app.command(name, epilog=f"Example: {example}")(run)
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
