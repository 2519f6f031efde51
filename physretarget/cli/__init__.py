"""The program ``physretarget``: argument parsing and exit codes, thin over the library's verbs.

Exit codes: 0 fine; 1 the judged thing failed; 2 unusable input or usage.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from physretarget._version import __version__
from physretarget.cli import common
from physretarget.errors import PhysretargetError

ORDER = (
    "demo", "retarget", "learn", "stream", "keyposes", "validate", "rules", "inspect", "replay",
    "convert", "suite", "serve", "token", "face", "reproduce",
)  # fmt: skip
"""Of commands in the help: as they are met with, not as they are imported."""


class _Ordered(TyperGroup):
    def list_commands(self, ctx: object) -> list[str]:
        return sorted(self.commands, key=ORDER.index)


app = typer.Typer(
    name="physretarget",
    cls=_Ordered,
    help="""Human motion capture to non-humanoid characters, and clips judged by physics.

    A character is a MuJoCo model (MJCF). Key poses say in pairs: where the actor does this, the
    character does that. A mapper is learned from them, and with it `retarget` turns a capture
    (BVH, C3D, TRC, AMC, DeepMimic) into a clip, the character's motion. `validate` says of any
    clip of a model whether it could happen.

    Exit codes: 0 fine, 1 the judged thing failed, 2 unusable input or usage.""",
    epilog="Example: physretarget demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"physretarget {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


# Importing a command's module registers it. Solvers and MuJoCo take a second, which is more
# than a nightly run in which nothing changed has to do: these come alone where they are meant.
if sys.argv[1:2] == ["suite"] and Path(sys.argv[0]).stem in ("physretarget", "__main__"):
    from physretarget.cli import suite
elif sys.argv[1:2] in (["serve"], ["token"]) and Path(sys.argv[0]).stem in (
    "physretarget",
    "__main__",
):
    from physretarget.cli import serve
else:
    from physretarget.cli import (  # noqa: F401
        convert,
        demo,
        face,
        keyposes,
        replay,
        reproduce,
        retarget,
        serve,
        stream,
        suggest,
        suite,
        validate,
    )


def main() -> None:
    """Run the program; every error is one sentence on stderr and exit code 2."""
    try:
        app()
    except PhysretargetError as error:
        if common.debug:
            raise
        common.fail(error)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        if common.debug:
            raise
        place = f"{error.filename}: " if error.filename else ""
        common.fail(PhysretargetError(f"{place}{error.strerror or error}."))
        sys.exit(2)
    except Exception as error:
        if common.debug:
            raise
        common.fail(
            PhysretargetError(
                f"this should not have happened ({type(error).__name__}: {error}); "
                "run again with --debug and report what it prints."
            )
        )
        sys.exit(2)
