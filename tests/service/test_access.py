"""Who may do what: tokens, scopes, tickets, rates, names of the host."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from physretarget.errors import UsageError
from physretarget.sandbox.confine import Walls
from physretarget.service.access import Rates
from physretarget.service.service import Service
from physretarget.service.settings import Settings
from physretarget.service.tokens import Tickets, Tokens, hashed, make_token

Start = Callable[..., Any]


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(scope="module")
def guarded(start: Start, clip: Callable[..., bytes]) -> tuple[Any, dict[str, str], str]:
    """A service with a token of every scope, and a finished job."""
    live = start()
    job = live.wait(live.submit(clip()).json()["id"])
    assert live.client.post(f"/api/v1/jobs/{job['id']}/share").status_code == 200
    made = {scope: make_token() for scope in ("read", "submit", "admin")}
    for scope, token in made.items():
        live.service.registry.add_token(scope, scope, hashed(token))
    live.service.tokens._until = -1
    return live, made, job["id"]


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_without_a_token_nothing_but_health(guarded: tuple[Any, dict[str, str], str]) -> None:
    live, _, id = guarded
    for path in ("/api/v1/jobs", f"/api/v1/jobs/{id}/report", "/metrics", "/api/v1/models/lamp"):
        answer = live.client.get(path)
        assert answer.status_code == 401, path
        assert answer.headers["www-authenticate"] == "Bearer"
        assert answer.json()["error"]["code"] == "unauthorized"
    health = live.client.get("/health")
    assert health.status_code == 200


@pytest.mark.parametrize("token", ["x", "prt_" + "A" * 43, "prt_" + "A" * 10_000, "é"])
def test_wrong_tokens(guarded: tuple[Any, dict[str, str], str], token: str) -> None:
    headers = {b"Authorization": b"Bearer " + token.encode()}
    assert guarded[0].client.get("/api/v1/jobs", headers=headers).status_code == 401


def test_scopes(guarded: tuple[Any, dict[str, str], str], clip: Callable[..., bytes]) -> None:
    live, tokens, id = guarded
    post = {"files": {"file": ("box.npz", clip())}}
    for scope, status in (("read", 403), ("submit", 201), ("admin", 201)):
        headers = bearer(tokens[scope])
        assert live.client.get(f"/api/v1/jobs/{id}", headers=headers).status_code == 200
        assert live.client.post("/api/v1/clips", headers=headers, **post).status_code == status
    answer = live.client.delete(f"/api/v1/jobs/{id}", headers=bearer(tokens["read"]))
    assert answer.status_code == 403
    assert "submit is needed" in answer.json()["error"]["message"]


def test_a_refused_caller_s_upload_is_not_read(guarded: tuple[Any, dict[str, str], str]) -> None:
    live, _, _ = guarded
    with socket.create_connection(("127.0.0.1", int(live.url.rpartition(":")[2]))) as raw:
        raw.sendall(
            b"POST /api/v1/clips HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 9999999\r\n"
            b"Content-Type: multipart/form-data; boundary=x\r\n\r\n"
        )
        assert b" 401 " in raw.recv(100)


def test_keys_of_two_callers_do_not_meet(
    guarded: tuple[Any, dict[str, str], str], clip: Callable[..., bytes]
) -> None:
    live, tokens, _ = guarded
    ids = set()
    for scope in ("submit", "admin"):
        answer = live.client.post(
            "/api/v1/jobs", data={"model": "lamp"}, files={"clip": ("a.npz", clip())},
            headers={"Idempotency-Key": "same", **bearer(tokens[scope])},
        )  # fmt: skip
        ids.add(answer.json()["id"])
    assert len(ids) == 2


def test_a_ticket_opens_one_page(guarded: tuple[Any, dict[str, str], str]) -> None:
    live, tokens, id = guarded
    path = f"/api/v1/jobs/{id}/report?format=html"
    answer = live.client.post(
        "/api/v1/tickets", json={"path": path}, headers=bearer(tokens["read"])
    )
    url = answer.json()["url"]
    assert live.client.get(url).status_code == 200
    assert live.client.get(path).status_code == 401
    assert live.client.get(url.replace("html", "json")).status_code == 401
    forged = url[:-1] + ("0" if url[-1] != "0" else "1")
    assert live.client.get(forged).status_code == 401
    ticket = url.partition("ticket=")[2]
    assert live.client.get(f"/api/v1/jobs?ticket={ticket}").status_code == 401
    assert live.client.post("/api/v1/tickets", json={"path": path}).status_code == 401
    refused = live.client.post(
        "/api/v1/tickets", json={"path": "/api/v1/jobs"}, headers=bearer(tokens["admin"])
    )
    assert refused.status_code == 422


def test_tickets_end() -> None:
    clock = Clock()
    tickets = Tickets(clock)
    ticket = tickets.make("/a?b", "me")
    assert tickets.holder("/a?b", ticket) == "me"
    assert not tickets.holder("/a?c", ticket)
    assert not Tickets(clock).holder("/a?b", ticket)
    clock.now += tickets.seconds + 1
    assert not tickets.holder("/a?b", ticket)
    for wrong in ("", ".", "9" * 11 + ".x", "1e5.x", "²." + "0" * 64):
        assert not tickets.holder("/a?b", wrong)


def test_a_revoked_token_ends_and_the_door_stays_shut(start: Start) -> None:
    live = start()
    clock = Clock()
    live.service.tokens = Tokens(live.service.registry, required=False, clock=clock)
    assert live.client.get("/api/v1/jobs").status_code == 200
    token = make_token()
    id = live.service.registry.add_token("ci", "read", hashed(token)).id
    clock.now += 10
    assert live.client.get("/api/v1/jobs").status_code == 401
    assert live.client.get("/api/v1/jobs", headers=bearer(token)).status_code == 200
    assert live.service.registry.revoke_token(id)
    assert not live.service.registry.revoke_token(id)
    clock.now += 10
    assert live.client.get("/api/v1/jobs", headers=bearer(token)).status_code == 401
    assert live.client.get("/api/v1/jobs").status_code == 401
    live.close()


def test_only_a_hash_of_a_token_is_kept(guarded: tuple[Any, dict[str, str], str]) -> None:
    live, tokens, _ = guarded
    content = b"".join(path.read_bytes() for path in live.service.home.folder.glob("history.db*"))
    for token in tokens.values():
        assert token.encode() not in content
        assert hashed(token).encode() in content


def test_beyond_loopback_only_with_tokens(tmp_path: Any, pool: Any) -> None:
    with pytest.raises(UsageError, match="token"):
        Service(Settings(data=tmp_path, require_tokens=True), pool)


# ---- rates -------------------------------------------------------------------------------------


def test_a_bucket_runs_dry_and_fills() -> None:
    clock = Clock()
    rates = Rates(60.0, 3, clock)
    assert [rates.take("a") for _ in range(3)] == [0, 0, 0]
    assert rates.take("a") == pytest.approx(1.0)
    assert rates.take("b") == 0
    clock.now += 2
    assert [rates.take("a") for _ in range(2)] == [0, 0]
    assert rates.take("a") > 0


def test_nobody_can_fill_the_memory() -> None:
    rates = Rates(60.0, 3, Clock())
    for n in range(20_000):
        rates.take(str(n))
    assert len(rates._buckets) <= 10_000


def test_too_many_requests(start: Start) -> None:
    live = start(rate=60, burst=5)
    answers = [live.client.get("/api/v1/jobs") for _ in range(8)]
    assert [a.status_code for a in answers[:5]] == [200] * 5
    assert answers[-1].status_code == 429
    assert int(answers[-1].headers["retry-after"]) >= 1
    assert answers[-1].json()["error"]["code"] == "too_many_requests"
    assert live.client.get("/health").status_code == 200
    live.close()


def test_who_guesses_tokens_is_slowed_down(start: Start) -> None:
    live = start()
    live.service.registry.add_token("ci", "read", hashed(make_token()))
    live.service.tokens._until = -1
    found = {live.client.get("/api/v1/jobs", headers=bearer(make_token())).status_code
             for _ in range(70)}  # fmt: skip
    assert found == {401, 429}
    live.close()


# ---- names of the host -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1", 200), ("localhost:8000", 200), ("LOCALHOST", 200), ("[::1]:80", 200),
        ("evil.example", 421), ("localhost.evil.example", 421), ("127.0.0.1.nip.io", 421),
        ("localhost:8000@evil.example", 421), ("", 421),
    ],
)  # fmt: skip
def test_only_our_names(live: Any, host: str, status: int) -> None:
    answer = live.client.get("/health", headers={"Host": host})
    assert answer.status_code == status
    if status == 421:
        assert answer.json()["error"]["code"] == "misdirected"


def test_other_pages_get_no_permission(live: Any) -> None:
    answer = live.client.request(
        "OPTIONS", "/api/v1/jobs",
        headers={"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"},
    )  # fmt: skip
    assert answer.status_code == 405
    assert not any(name.startswith("access-control") for name in answer.headers)
    assert "set-cookie" not in answer.headers


def test_a_page_elsewhere_cannot_submit_in_a_visitor_s_name(
    live: Any, clip: Callable[..., bytes]
) -> None:
    # A form of another site needs no permission to post; on loopback nobody asks for a token.
    answer = live.submit(clip(), headers={"Origin": "https://evil.example"})
    assert answer.status_code == 403
    assert live.submit(clip(), headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert live.submit(clip(), headers={"Origin": live.url}).status_code == 202


def test_what_is_no_http(live: Any) -> None:
    with socket.create_connection(("127.0.0.1", int(live.url.rpartition(":")[2]))) as raw:
        raw.sendall(b"\x16\x03\x01\x02\x00\r\n\r\n")
        answer = b"".join(iter(lambda: raw.recv(10_000), b""))
    assert answer.startswith(b"HTTP/1.1 400")
    assert b'"bad_request"' in answer


def test_slow_headers_are_cut_off(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("physretarget.service.protocol.HEADER_S", 0.3)
    live = start()
    with socket.create_connection(("127.0.0.1", int(live.url.rpartition(":")[2]))) as raw:
        raw.settimeout(5)
        raw.sendall(b"GET /health HTTP/1.1\r\nHost: ")
        with contextlib.suppress(ConnectionResetError):
            assert raw.recv(100) == b""
    # One that is done keeps its connection.
    with httpx.Client(base_url=live.url) as client:
        assert client.get("/health").status_code == 200
    live.close()


def test_a_kernel_without_walls_is_in_the_log(
    tmp_path: Path, pool: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bare = Walls(landlock=0, seccomp=False)
    monkeypatch.setattr("physretarget.service.service.available", lambda: bare)
    service = Service(Settings(data=tmp_path / "data"), pool)
    try:
        service.start()
    finally:
        service.stop()
    assert sum("does not keep jobs from" in record.message for record in caplog.records) == 2


@pytest.fixture(scope="module")
def two(start: Start, clip: Callable[..., bytes]) -> tuple[Any, dict[str, str], str, str]:
    """Two owners and an admin; a finished job and a clip of the first."""
    live = start()
    box = live.box()
    assert live.client.post(f"/api/v1/models/{box}/share").status_code == 200
    made = {name: make_token() for name in ("anna", "ben", "root")}
    for name, token in made.items():
        scope = "admin" if name == "root" else "submit"
        live.service.registry.add_token(name, scope, hashed(token))
    live.service.tokens._until = -1
    headers = bearer(made["anna"])
    post = {"files": {"file": ("secret.npz", clip())}}
    mine = live.client.post("/api/v1/clips", headers=headers, **post).json()["id"]
    form = {"model": (None, box), "clip_id": (None, mine)}
    job = live.client.post("/api/v1/jobs", files=form, headers=headers).json()["id"]
    for _ in range(600):
        if live.client.get(f"/api/v1/jobs/{job}", headers=headers).json()["status"] == "done":
            break
        time.sleep(0.1)
    return live, made, job, mine


def _doors(job: str, clip: str) -> list[tuple[str, str, dict[str, Any]]]:
    """Every route that reads or changes a thing of somebody's."""
    both = f"left={job}&right={job}"
    return [
        *(("GET", f"/api/v1/jobs/{job}{end}", {})
          for end in ("", "/report", "/report?format=html", "/replay", "/clip", "/events")),
        ("GET", f"/api/v1/compare?{both}", {}), ("GET", f"/api/v1/compare/replay?{both}", {}),
        ("POST", f"/api/v1/jobs/{job}/cancel", {}), ("POST", f"/api/v1/jobs/{job}/share", {}),
        ("GET", f"/api/v1/clips/{clip}", {}), ("POST", f"/api/v1/clips/{clip}/share", {}),
        ("POST", "/api/v1/jobs", {"files": {"model": (None, "lamp"), "clip_id": (None, clip)}}),
        ("DELETE", f"/api/v1/clips/{clip}", {}), ("DELETE", f"/api/v1/jobs/{job}", {}),
    ]  # fmt: skip


def test_nothing_of_one_owner_is_there_for_another(
    two: tuple[Any, dict[str, str], str, str],
) -> None:
    live, tokens, job, clip = two
    headers = bearer(tokens["ben"])
    for method, path, more in _doors(job, clip):
        answer = live.client.request(method, path, headers=headers, **more)
        assert answer.status_code == 404, (method, path, answer.text)
    for kind in ("jobs", "clips", "models"):
        items = live.client.get(f"/api/v1/{kind}?q=secret", headers=headers).json()["items"]
        assert items == [], kind
    path = f"/api/v1/jobs/{job}/report?format=html"
    ticket = live.client.post("/api/v1/tickets", json={"path": path}, headers=headers).json()
    assert live.client.get(ticket["url"]).status_code == 404


def test_an_admin_sees_all_and_what_is_shared_is_read_and_not_changed(
    two: tuple[Any, dict[str, str], str, str],
) -> None:
    live, tokens, job, clip = two
    admin, other, mine = (bearer(tokens[name]) for name in ("root", "ben", "anna"))
    assert live.client.get(f"/api/v1/jobs/{job}", headers=admin).status_code == 200
    for path in (f"/api/v1/jobs/{job}/share", f"/api/v1/clips/{clip}/share"):
        assert live.client.post(path, headers=mine).status_code == 200
    reads = [
        d for d in _doors(job, clip) if d[0] == "GET" and not d[1].endswith(("/clip", "/events"))
    ]
    for method, path, more in reads:
        assert live.client.request(method, path, headers=other, **more).status_code == 200, path
    for method, path, more in _doors(job, clip):
        if method == "DELETE" or path.endswith("/share") or path.endswith("/cancel"):
            answer = live.client.request(method, path, headers=other, **more)
            assert answer.status_code == 404, (method, path)
    assert live.client.post(f"/api/v1/jobs/{job}/share?shared=false", headers=mine).is_success
    assert live.client.get(f"/api/v1/jobs/{job}", headers=other).status_code == 404


def test_a_revoked_token_takes_its_tickets_along(
    two: tuple[Any, dict[str, str], str, str],
) -> None:
    live, _, job, _ = two
    token = make_token()
    made = live.service.registry.add_token("carl", "admin", hashed(token))
    live.service.tokens._until = -1
    path = f"/api/v1/jobs/{job}/report?format=html"
    url = live.client.post("/api/v1/tickets", json={"path": path}, headers=bearer(token)).json()
    assert live.client.get(url["url"]).status_code == 200
    live.service.registry.revoke_token(made.id)
    live.service.tokens._until = -1
    assert live.client.get(url["url"]).status_code == 401
