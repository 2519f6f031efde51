"""The program ``physretarget``: argument parsing and exit codes, thin over the library's verbs.

Exit codes: 0 fine; 1 the judged thing failed; 2 unusable input or usage.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import Annotated, Any

import typer
import typer.main
from typer.core import TyperCommand, TyperGroup

from physretarget._version import __version__
from physretarget.cli import common
from physretarget.errors import PhysretargetError

COMMANDS = {
    "demo": ("demo", "Have a desk lamp act out a real jump and dance."),
    "retarget": ("retarget", "Turn captures into clips of a character."),
    "learn": ("retarget", "Learn a mapper from key poses, once for many captures."),
    "stream": ("stream", "Retarget frame by frame: JSON lines in, JSON lines out."),
    "keyposes": ("suggest", "Check, draw, suggest, propose and plant key poses."),
    "studio": ("studio", "Pose key poses in the browser."),
    "character": ("character", "Make a character from a robot's file."),
    "validate": ("validate", "Judge clips, or all clips of a folder, by physics."),
    "rules": ("validate", "Explain the rules: meaning, threshold, source."),
    "inspect": ("inspect", "Audit a character, or show how a capture is read."),
    "simulate": ("simulate", "Play a clip forward in MuJoCo, by joint torques."),
    "replay": ("replay", "Play a clip with its forces: a window, a film or a page."),
    "forces": ("forces", "Estimate the ground forces of a capture without force plates."),
    "convert": ("convert", "Convert a clip between file formats."),
    "fix": ("fix", "Repair clips by the smallest change."),
    "suite": ("suite", "Judge a whole library every night and report what changed."),
    "serve": ("serve", "Judge and retarget over HTTP, with a web page."),
    "token": ("serve", "Make, list and revoke tokens of the service."),
    "backup": ("serve", "Back up a service's database and files into one archive."),
    "restore": ("serve", "Restore a service's data folder from a backup."),
    "face": ("face", "Turn facial capture into an animator's sparse curves."),
    "reproduce": ("reproduce", "Make a paper's figures and tables from real data."),
}
"""Name → module of this package that registers it, and the first line of its help.

In the order of the help: as they are met with. A module is imported when its command is asked for:
solvers and MuJoCo take a second.
"""


class _Lazy(TyperGroup):
    """The program's group: until a command is asked for, a name and a line stand for it."""

    def __init__(self, *, commands: dict[str, Any], **attributes: Any) -> None:
        stubs = {name: TyperCommand(name, help=line) for name, (_, line) in COMMANDS.items()}
        super().__init__(commands=stubs | commands, **attributes)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] in COMMANDS:
            self.load(args[0])
        return super().resolve_command(ctx, args)

    def load(self, name: str) -> Any:
        """Import a command and put it in the place of its stub."""
        import_module(f"physretarget.cli.{COMMANDS[name][0]}")
        made = typer.main.get_command(app)
        assert isinstance(made, TyperGroup)
        self.commands[name] = made.commands[name]
        return self.commands[name]


app = typer.Typer(
    name="physretarget",
    cls=_Lazy,
    help="""Retarget human motion capture to any character, and judge clips by physics.

    A character is a MuJoCo model (MJCF). Key poses are pairs: when the actor stands like this, the
    character stands like that. `learn` makes a mapper of them; `retarget` turns a capture (BVH,
    C3D, TRC, FBX and others) into a clip, the character's motion. `validate` says whether a clip of
    any model could happen.

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
