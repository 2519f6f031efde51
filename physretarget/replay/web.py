"""The browser screen: one HTML file that plays a scene with no network at all."""

from __future__ import annotations

import os
import webbrowser
from functools import cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path

from jinja2 import Environment
from markupsafe import Markup

from physretarget._version import __version__
from physretarget.errors import UsageError
from physretarget.files import write_file
from physretarget.replay.payload import payload, script_json
from physretarget.replay.scene import Scene

# Order matters: the library, then the clock, then what stands on both.
_SCRIPTS = ("three.min.js", "clock.js", "stage.js", "player.js")


@cache
def asset(name: str) -> str:
    """Text of a file in ``replay/assets``."""
    return (resources.files("physretarget.replay") / "assets" / name).read_text("utf-8")


def player_scripts() -> tuple[Markup, ...]:
    """The player's scripts, to be inlined in this order; our own files, hence trusted."""
    return tuple(Markup(asset(name)) for name in _SCRIPTS)


def player_css() -> Markup:
    """The player's style sheet, to be inlined."""
    return Markup(asset("player.css"))


def scene_json(scene: Scene) -> Markup:
    """The scene's data for a ``<script type="application/json">``; escaped against breakout."""
    return Markup(script_json(payload(scene)))


def render(
    scene: Scene,
    *,
    title: str | None = None,
    autoplay: bool = True,
    verdict: str = "",
    outcome: str = "",
) -> str:
    """The page as text; the title and every name in the scene may be hostile.

    With a ``verdict``, a sentence, title and verdict stand above the player; its ``outcome`` is
    "passed", "failed" or "not judged".
    """
    template = Environment(autoescape=True).from_string(asset("page.html.j2"))
    return template.render(
        title=title or scene.title,
        version=__version__,
        player_css=player_css(),
        scripts=player_scripts(),
        scene_json=scene_json(scene),
        autoplay=autoplay,
        verdict=verdict,
        outcome=outcome,
    )


def write_html(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    autoplay: bool = True,
    verdict: str = "",
    outcome: str = "",
) -> Path:
    """Write the page of :func:`render`: one file, no other needed; same scene, same bytes.

    Args:
        scene: What to show.
        path: The file.
        title: Headline, the scene's if None.
        autoplay: Whether it plays at once.
        verdict: Sentence below the headline.
        outcome: passed, failed or not judged, which colours the sentence.

    Returns:
        The file.

    Raises:
        InputError: the file cannot be written.
    """
    write_file(
        path,
        render(scene, title=title, autoplay=autoplay, verdict=verdict, outcome=outcome).encode(),
    )
    return Path(path)


def server(text: str, *, port: int = 0) -> ThreadingHTTPServer:
    """A server of that one page on the loopback interface; port 0 takes a free one.

    Raises:
        UsageError: the port is taken or not allowed.
    """
    content = text.encode("utf-8")

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = self.path.split("?", 1)[0] == "/"
            body = content if found else b"not found"
            self.send_response(HTTPStatus.OK if found else HTTPStatus.NOT_FOUND)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            """Stay silent: the terminal belongs to the command."""

    try:
        return ThreadingHTTPServer(("127.0.0.1", port), Page)
    except (OSError, OverflowError) as error:
        raise UsageError(f"cannot listen on 127.0.0.1:{port}: {error}.") from error


def serve(text: str, *, port: int = 0, open_browser: bool = True) -> None:
    """Serve a page on loopback until interrupted; opens the browser, if there is one."""
    with server(text, port=port) as running:
        address = f"http://127.0.0.1:{running.server_address[1]}/"
        print(f"Replay at {address} (Ctrl-C ends it)", flush=True)
        if open_browser:
            webbrowser.open(address)
        try:
            running.serve_forever()
        except KeyboardInterrupt:
            return
