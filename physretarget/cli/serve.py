"""serve and token: the HTTP service and who may use it."""

from __future__ import annotations

import importlib.util
import ipaddress
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from physretarget.cli import app, common
from physretarget.cli.common import command, complete, one_of, say
from physretarget.errors import MissingExtraError, UsageError

if TYPE_CHECKING:
    # The service needs an extra; every other command must do without it.
    from physretarget.sandbox.limits import Limits
    from physretarget.suite.registry import Registry

group = typer.Typer(
    help="Make, list and revoke tokens of the service.",
    epilog="Example: physretarget token create --scope submit --name ci",
    no_args_is_help=True,
)
app.add_typer(group, name="token")

_SCOPES = ("read", "submit", "admin")
_PACKAGES = ("sqlalchemy", "fastapi", "uvicorn", "python_multipart", "prometheus_client")
Data = Annotated[
    Path, typer.Option("--data", metavar="DIR", help="Folder of uploads, results and the history.")
]
History = Annotated[
    str | None,
    typer.Option(
        "--history",
        metavar="URL",
        help="Database, if it is not in --data: sqlite:///FILE or postgresql://…/DB.",
    ),
]
_DATA = Path("physretarget-data")


@command(app, "serve", example="physretarget serve --data /var/lib/physretarget --workers 4")
def serve_command(
    host: Annotated[
        str,
        typer.Option(
            "--host",
            metavar="ADDRESS",
            help=("Address to listen on; other than this machine only after a token was " "made."),
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            "--port", metavar="N", min=0, max=65535, help="Port to listen on; 0 picks a free one."
        ),
    ] = 8000,
    data: Data = _DATA,
    history: History = None,
    workers: Annotated[int, typer.Option(
        "--workers", metavar="N", min=1, max=64, help="Number of jobs run in parallel.")] = 2,
    name: Annotated[
        list[str] | None,
        typer.Option(
            "--name", metavar="HOST",
            help="Public host name, for example of a proxy; requires tokens. May be given several "
            "times.",
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            "--limit", metavar="NAME=VALUE",
            help="Limit on uploads and jobs (upload_bytes, seconds, memory_bytes, …); may be given "
            "several times.",
        ),
    ] = None,
    rate: Annotated[
        float, typer.Option("--rate", metavar="N", min=0,
            help="Requests per minute and caller; 0 is unlimited.")
    ] = 1200,
    reserve: Annotated[
        int, typer.Option("--reserve", metavar="MB", min=0,
            help=("Free disk space in MB to keep: below it uploads are refused and jobs " "wait."))
    ] = 256,
    root_path: Annotated[str, typer.Option(
        "--root-path", metavar="PATH",
        help="Path below which a proxy offers the service, for example /clips.")] = "",
    proxy: Annotated[
        list[str] | None,
        typer.Option(
            "--proxy", metavar="ADDRESS",
            help="Address or network of a proxy whose X-Forwarded-For and X-Forwarded-Proto are "
            "believed. May be given several times.",
        ),
    ] = None,
    tls_cert: Annotated[
        Path | None, typer.Option("--tls-cert", metavar="FILE.pem", exists=True, dir_okay=False,
            help="TLS certificate with its chain; the service then speaks https.")
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option("--tls-key", metavar="FILE.pem", exists=True, dir_okay=False,
            help="Key of the certificate, if it is not in the same file.")
    ] = None,
) -> None:  # fmt: skip
    """Judge and retarget over HTTP, with a web page.

    Jobs run in confined child processes. docs/service.md describes the API.
    """
    _check_extra()
    from physretarget.listen import address, is_loopback, listen
    from physretarget.sandbox.limits import Limits
    from physretarget.service import logs
    from physretarget.service.home import Home
    from physretarget.service.settings import LOOPBACK, Settings

    if tls_key is not None and tls_cert is None:
        raise UsageError("--tls-key needs --tls-cert: the certificate that the key is of.")
    logs.set_up(quiet=common.messages.quiet)
    local = is_loopback(host)
    settings = Settings(
        data=data, history=_history(history), workers=workers, rate=rate,
        reserve=reserve * 2**20, tls_cert=tls_cert, tls_key=tls_key,
        root_path=_root_path(root_path), proxies=tuple(_network(each) for each in proxy or ()),
        hosts=(*(LOOPBACK if local or name else ()), *({host} if local else ()), *(name or ())),
        require_tokens=not local or bool(name),
    )  # fmt: skip
    settings = replace(settings, limits=_limits(Limits(), limit or []))
    Home(data)
    with listen(host, port) as listening:
        # Only now: MuJoCo and the rest take a second, in which nobody should wait for an error.
        from physretarget.service.server import serve

        url = address(listening, host)
        if tls_cert is not None:
            url = url.replace("http://", "https://", 1)
        serve(settings, listening, lambda: typer.echo(f"physretarget listens at {url}"))


def _root_path(told: str) -> str:
    path = told.rstrip("/")
    if path and not re.fullmatch(r"(/[A-Za-z0-9._~-]+)+", path):
        raise UsageError(f"--root-path is {told!r}; it begins with a slash, like /clips.")
    return path


def _network(told: str) -> str:
    try:
        ipaddress.ip_network(told)
    except ValueError as error:
        raise UsageError(
            f"--proxy is {told!r}; it is an address such as 10.0.0.5 or a network such as "
            "10.0.0.0/8."
        ) from error
    return told


@command(group, "create", example="physretarget token create --scope submit --name ci")
def create_command(
    scope: Annotated[
        str, typer.Option("--scope", help="What the token allows.", **complete(_SCOPES))
    ],
    name: Annotated[
        str, typer.Option("--name", metavar="TEXT", help="Who uses the token, or what for.")
    ],
    data: Data = _DATA,
    history: History = None,
) -> None:
    """Make a token and print it once; only its hash is stored."""
    one_of(scope, _SCOPES, "--scope")
    if not name.strip() or len(name) > 100 or not name.isprintable():
        raise UsageError("--name must have 1 to 100 printable characters.")
    _check_extra()
    from physretarget.service.tokens import hashed, make_token

    token = make_token()
    made = _registry(data, history).add_token(name.strip(), scope, hashed(token))
    say(f"token {made.id} ({scope}) for {made.name}; it is not shown again:")
    typer.echo(token)


@command(group, "list", example="physretarget token list")
def list_command(data: Data = _DATA, history: History = None) -> None:
    """List all tokens.

    Shows id, scope, date, whether it is revoked, and name.
    """
    _check_extra()
    for token in _registry(data, history).tokens():
        state = f"revoked {token.revoked}" if token.revoked else "valid"
        typer.echo(f"{token.id}  {token.scope:6}  {token.created}  {state}  {token.name}")


@command(group, "revoke", example="physretarget token revoke 01k9p2…")
def revoke_command(
    token: Annotated[
        str, typer.Argument(metavar="ID", help="Id of the token, as shown by 'token list'.")
    ],
    data: Data = _DATA,
    history: History = None,
) -> None:
    """Revoke a token; a running service knows within seconds."""
    _check_extra()
    if not _registry(data, history).revoke_token(token):
        raise UsageError(f"there is no valid token with the id {token!r}.")
    say(f"token {token} is revoked.")


def _check_extra() -> None:
    for package in _PACKAGES:
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError(package, extra="service", purpose="The HTTP service")


def _history(told: str | None) -> str | None:
    from physretarget.suite.file import database_url

    return database_url(told, Path.cwd()) if told else None


def _registry(data: Path, history: str | None) -> Registry:
    from physretarget.service.home import Home
    from physretarget.suite.registry import Registry
    from physretarget.suite.store import Store

    home = Home(data)
    return Registry(Store(_history(history) or home.history), home.id)


def _limits(limits: Limits, told: list[str]) -> Limits:
    values = limits.to_dict()
    for each in told:
        name, _, text = each.partition("=")
        if name not in values:
            raise UsageError(f"--limit {name!r} is none; there are {', '.join(sorted(values))}.")
        try:
            values[name] = type(values[name])(text)
        except ValueError as error:
            raise UsageError(f"--limit {name} needs a number, not {text!r}.") from error
    return type(limits).from_dict(values)


@command(app, "backup", example="physretarget backup --data service --out nightly.tar")
def backup_command(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.tar", help="Archive to write.")],
    data: Data = _DATA,
    history: History = None,
) -> None:
    """Back up a service's database and files into one archive."""
    _check_extra()
    from physretarget.service.backup import back_up

    counts = back_up(data, _history(history), out)
    say(f"{out}: {_counted(counts)}.")


@command(app, "restore", example="physretarget restore nightly.tar --data /var/lib/other")
def restore_command(
    archive: Annotated[
        Path, typer.Argument(metavar="FILE.tar", help="Archive written by 'backup'.")
    ],
    data: Data = _DATA,
    history: History = None,
) -> None:
    """Restore a service's data folder from a backup."""
    _check_extra()
    from physretarget.service.backup import restore

    counts = restore(archive, data, _history(history))
    say(f"{data}: {_counted(counts)}.")


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{number} {name}" for name, number in counts.items())
