"""Below a path of a proxy that speaks TLS: page, upload, events, replay, links."""

from __future__ import annotations

import http.client
import ssl
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

ROOT = "/studio/clips"
MODEL = b"""<mujoco model="box"><worldbody><geom name="floor" type="plane" size="0 0 1"/>
  <body name="box" pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""


class _Proxy(ThreadingHTTPServer):
    """What nginx does for a location: TLS ends here, forwarded headers are set."""

    daemon_threads = True

    def __init__(self, target: str, certificate: tuple[Path, Path], *, strip: bool) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.target, self.strip = urlsplit(target), strip
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*certificate)
        self.socket = context.wrap_socket(self.socket, server_side=True)
        self.url = f"https://localhost:{self.server_address[1]}"
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Browsers hang up when they have seen enough."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Proxy

    def _pass(self) -> None:
        if not self.path.startswith(ROOT):
            self.send_error(404)
            return
        path = (self.path.removeprefix(ROOT) or "/") if self.server.strip else self.path
        length = int(self.headers.get("Content-Length", 0))
        headers = {k: v for k, v in self.headers.items() if k.lower() != "connection"}
        headers |= {"X-Forwarded-For": "203.0.113.7", "X-Forwarded-Proto": "https"}
        assert self.server.target.hostname
        wire = http.client.HTTPConnection(self.server.target.hostname, self.server.target.port)
        wire.request(self.command, path, self.rfile.read(length), headers)
        answer = wire.getresponse()
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("transfer-encoding", "connection", "date", "server"):
                self.send_header(name, value)
        self.send_header("Connection", "close")
        self.end_headers()
        while part := answer.read1(65536):
            self.wfile.write(part)
            self.wfile.flush()
        self.close_connection = True
        wire.close()

    do_GET = do_HEAD = do_POST = do_DELETE = do_PUT = _pass

    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture(params=[True, False], ids=["stripped", "kept"])
def behind(
    request: pytest.FixtureRequest, start: Callable[..., Any], certificate: tuple[Path, Path]
) -> Iterator[tuple[Any, _Proxy]]:
    live = start(workers=1, root_path=ROOT, proxies=("127.0.0.1",))
    proxy = _Proxy(live.url, certificate, strip=request.param)
    yield live, proxy
    proxy.shutdown()
    live.close()


def test_links_lead_back_through_the_proxy(
    behind: tuple[Any, _Proxy], certificate: tuple[Path, Path], clip: Callable[..., bytes]
) -> None:
    live, proxy = behind
    trusted = ssl.create_default_context(cafile=str(certificate[0]))
    with httpx.Client(base_url=proxy.url, verify=trusted, timeout=30) as client:
        if not proxy.strip:  # a proxy that takes the path away has to do this itself
            assert client.get(ROOT).headers["Location"] == f"{ROOT}/"
        assert client.get(f"{ROOT}/").status_code == 200
        model = client.post(f"{ROOT}/api/v1/models", files={"file": ("box.xml", MODEL)})
        assert model.headers["Location"].startswith(f"{ROOT}/api/v1/models/")
        made = client.post(
            f"{ROOT}/api/v1/jobs", data={"model": model.json()["id"]},
            files={"clip": ("box.npz", clip())},
        )  # fmt: skip
        assert made.status_code == 202, made.text
        links = made.json()["links"]
        assert made.headers["Location"] == links["self"]
        live.wait(made.json()["id"])
        for name in ("self", "report", "replay", "events"):
            assert client.get(links[name]).status_code == 200, name
        path = f"/api/v1/jobs/{made.json()['id']}/report?format=html"
        ticket = client.post(f"{ROOT}/api/v1/tickets", json={"path": path}).json()["url"]
        assert ticket.startswith(f"{ROOT}/api/v1/jobs/")
        assert client.get(ticket).status_code == 200
        assert client.get(f"{ROOT}/nowhere").status_code == 404


@pytest.mark.parametrize("trusted", [(), ("127.0.0.1",), ("10.0.0.0/8",)])
def test_only_a_trusted_proxy_says_who_asks(
    start: Callable[..., Any], trusted: tuple[str, ...]
) -> None:
    """Callers behind a trusted proxy have a rate each, others share that of their address."""
    live = start(workers=1, proxies=trusted, rate=1.0, burst=2)
    told = [
        live.client.get("/api/v1/jobs", headers={"X-Forwarded-For": f"203.0.113.{k}"}).status_code
        for k in range(4)
    ]
    assert told == ([200] * 4 if trusted == ("127.0.0.1",) else [200, 200, 429, 429])
    live.close()


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [("--root-path", "clips", "begins with a slash"), ("--proxy", "nginx", "an address such as")],
)
def test_what_cannot_be_is_refused_at_once(
    tmp_path: Path, option: str, value: str, words: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "physretarget", "serve", "--data", str(tmp_path / "d"),
         option, value],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())


def test_the_page_works_below_a_path(behind: tuple[Any, _Proxy], browser: Any) -> None:
    """An example is judged in Chromium: upload, progress by events, report, replay, comparison."""
    from playwright.sync_api import expect

    _, proxy = behind
    context = browser.new_context(ignore_https_errors=True, viewport={"width": 1280, "height": 800})
    page = context.new_page()
    told: list[str] = []
    page.on("pageerror", lambda error: told.append(str(error)))
    page.on("response", lambda answer: told.append(answer.url) if answer.status >= 400 else None)
    page.on(
        "request",
        lambda asked: (
            None
            if asked.url.startswith((f"{proxy.url}{ROOT}/", "data:", "blob:", "about:"))
            else told.append(f"left the path: {asked.url}")
        ),
    )
    page.set_default_timeout(30_000)
    page.goto(f"{proxy.url}{ROOT}/")
    page.get_by_role("button", name="Try the example").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("lamp-jump.npz")
    expect(page.locator(".findings li").first).to_be_visible(timeout=60_000)
    expect(page.frame_locator("iframe").locator(".pr-clock")).to_be_visible(timeout=60_000)
    with page.expect_download() as got:
        page.get_by_role("link", name="SARIF").click()
    assert got.value.suggested_filename == "lamp-jump.sarif"
    assert told == []
    context.close()
