"""Forms are bounded while they come, and nothing of a refused one stays."""

from __future__ import annotations

import asyncio
import hashlib
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from fastapi import Request
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.service.errors import ApiError
from physretarget.service.uploads import Bounds, _safe, received

BOUNDS = Bounds(
    fields=frozenset({"kind", "options"}), files={"clip": 1, "keyposes": 3}, bytes=10_000,
    idle=5.0, rate=1.0,
)  # fmt: skip
TYPE = "multipart/form-data; boundary=b"


def request(chunks: list[bytes], kind: str = TYPE, **headers: str) -> Request:
    waiting = [{"type": "http.request", "body": c, "more_body": True} for c in chunks]
    waiting.append({"type": "http.request", "body": b"", "more_body": False})

    async def receive() -> dict[str, Any]:
        return waiting.pop(0)

    named = {"content-type": kind, **headers}
    scope = {
        "type": "http", "method": "POST", "path": "/", "query_string": b"",
        "headers": [(k.encode(), v.encode()) for k, v in named.items()],
    }  # fmt: skip
    return Request(scope, receive)


def receive(
    folder: Path, chunks: list[bytes], **told: Any
) -> tuple[dict[str, str], dict[str, list[tuple[str, bytes]]]]:
    """Fields, and files by name with their content, while the form is open."""

    async def run() -> tuple[dict[str, str], dict[str, list[tuple[str, bytes]]]]:
        async with received(request(chunks, **told), folder, BOUNDS) as form:
            files = {
                name: [(u.name, u.path.read_bytes()) for u in each]
                for name, each in form.files.items()
            }
            for each in form.files.values():
                for upload in each:
                    content = upload.path.read_bytes()
                    assert upload.sha256 == hashlib.sha256(content).hexdigest()
                    assert upload.bytes == len(content)
                    assert upload.path.stat().st_mode & 0o077 == 0
            return dict(form.fields), files

    try:
        return asyncio.run(run())
    finally:
        assert list(folder.iterdir()) == []


def part(name: str, content: bytes, filename: str | None = None) -> bytes:
    file = "" if filename is None else f'; filename="{filename}"'
    head = f'--b\r\nContent-Disposition: form-data; name="{name}"{file}\r\n\r\n'
    return head.encode() + content + b"\r\n"


END = b"--b--\r\n"


def test_fields_and_files(tmp_path: Path) -> None:
    body = part("kind", b"validate") + part("clip", b"\x00\r\n--b\x00", "a.npz") + END
    for chunks in ([body], [body[n : n + 1] for n in range(len(body))]):
        fields, files = receive(tmp_path, chunks)
        assert fields == {"kind": "validate"}
        assert files == {"clip": [("a.npz", b"\x00\r\n--b\x00")]}


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (part("clip", b"x" * 10_001, "a") + END, 413),
        (part("kind", b"x" * 300_000) + END, 413),
        (part("clip", b"", "a") + part("clip", b"", "b") + END, 422),
        (part("kind", b"a") + part("kind", b"b") + END, 422),
        (part("nobody", b"") + END, 422),
        (part("kind", b"", "a") + END, 422),
        (part("clip", b"") + END, 422),
        (part("kind", b"\xff") + END, 422),
        (part("keyposes", b"", "k") * 70 + END, 422),
        (part("clip", b"cut off", "a")[:-4], 422),
        (b"", 422),
        (b"no form at all", 422),
        (b"--b\r\n" + b"X-A: " + b"a" * 20_000 + b"\r\n\r\n" + END, 422),
        (b"--b\r\n" + b"".join(b"X-%d: a\r\n" % n for n in range(50)) + b"\r\n" + END, 422),
        (b"--b\r\n\r\nno disposition\r\n" + END, 422),
    ],
)
def test_forms_that_are_refused(tmp_path: Path, body: bytes, status: int) -> None:
    with pytest.raises(ApiError) as error:
        receive(tmp_path, [body[n : n + 4096] for n in range(0, len(body), 4096)])
    assert error.value.status == status


@pytest.mark.parametrize(
    ("kind", "status"),
    [("application/json", 415), ("", 415), ("multipart/form-data", 422),
     ("multipart/form-data; boundary=" + "b" * 400, 422), ("multipart/mixed; boundary=b", 415)],
)  # fmt: skip
def test_bodies_that_are_no_form(tmp_path: Path, kind: str, status: int) -> None:
    with pytest.raises(ApiError) as error:
        receive(tmp_path, [END], kind=kind)
    assert error.value.status == status


def test_a_told_length_that_is_too_large_is_refused_before_a_byte_is_kept(tmp_path: Path) -> None:
    with pytest.raises(ApiError) as error:
        receive(tmp_path, [], **{"content-length": str(10**12)})
    assert error.value.status == 413


def test_an_endless_body_ends(tmp_path: Path) -> None:
    """More parts than a form has room for, each small enough."""
    with pytest.raises(ApiError) as error:
        receive(tmp_path, [b"--b\r\nContent-Disposition: form-data; name=clip; filename=a\r\n\r\n",
                           *[b"x" * 1000] * 20])  # fmt: skip
    assert error.value.status == 413


@given(st.lists(st.one_of(
    st.binary(max_size=60),
    st.sampled_from([b"--b", b"\r\n", b"--b\r\n", END, b"\r\n\r\n", b"--", b"\r",
                     b'Content-Disposition: form-data; name="clip"; filename="x"\r\n',
                     b'Content-Disposition: form-data; name="kind"\r\n', b"Content-Length: 1\r\n"]),
), max_size=30))  # fmt: skip
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_whatever_comes_is_a_form_or_refused(
    tmp_path_factory: pytest.TempPathFactory, chunks: list[bytes]
) -> None:
    folder = tmp_path_factory.getbasetemp() / "forms"
    folder.mkdir(exist_ok=True)
    with suppress(ApiError):  # and no other error
        receive(folder, chunks)


@given(st.binary(max_size=400))
def test_names_of_files_are_tame(name: bytes) -> None:
    tame = _safe(name)
    assert 0 < len(tame.encode()) <= 200
    assert "/" not in tame
    assert "\\" not in tame
    assert tame not in (".", "..")
    assert tame.isprintable()


@pytest.mark.parametrize(
    ("told", "kept"),
    [(b"../../etc/passwd", "passwd"), (b"C:\\clips\\a.npz", "a.npz"), (b"..", "unnamed"),
     (b"a\x00b.csv", "a_b.csv"), (b"\xff.npz", "\ufffd.npz"), ("é".encode() * 300 + b".npz",
      "é" * 98 + ".npz")],
)  # fmt: skip
def test_names_are_kept_where_they_can_be(told: bytes, kept: str) -> None:
    assert _safe(told) == kept


# ---- over loopback -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(start: Callable[..., Any]) -> Any:
    return start(limits={"upload_bytes": 100_000}, upload_idle=0.5)


def test_a_client_that_sends_too_much_reads_the_answer(small: Any) -> None:
    answer = small.client.post("/api/v1/clips", files={"file": ("a.npz", b"x" * 3_000_000)})
    assert answer.status_code == 413
    assert answer.json()["error"]["code"] == "too_large"


def test_an_upload_without_a_length_is_bounded_too(small: Any) -> None:
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.npz"\r\n\r\n'
        while sent < 200:
            sent += 1
            yield b"x" * 65536

    answer = small.client.post("/api/v1/clips", content=endless(), headers={"Content-Type": TYPE})
    assert answer.status_code == 413
    assert list(small.service.home.incoming.iterdir()) == []


def test_a_client_that_falls_silent_is_let_go(small: Any) -> None:
    port = int(small.url.rpartition(":")[2])
    began = time.monotonic()
    with socket.create_connection(("127.0.0.1", port)) as raw:
        raw.sendall(
            b"POST /api/v1/clips HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5000\r\n"
            b"Content-Type: multipart/form-data; boundary=b\r\n\r\n--b\r\n"
        )
        raw.settimeout(10)
        assert b" 408 " in raw.recv(1000)
    assert time.monotonic() - began < 6
    assert list(small.service.home.incoming.iterdir()) == []


def test_a_client_that_goes_away_leaves_nothing(small: Any) -> None:
    port = int(small.url.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as raw:
        raw.sendall(
            b"POST /api/v1/clips HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50000\r\n"
            b"Content-Type: multipart/form-data; boundary=b\r\n\r\n" + part("file", b"x", "a")
        )
        time.sleep(0.1)
    until = time.monotonic() + 5
    while list(small.service.home.incoming.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.05)
