"""The API as its clients see it, over loopback, with real children."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from physretarget.service import routes_results

Clip = Callable[..., bytes]
MODELS = Path(__file__).parent.parent.parent / "models"


@pytest.fixture(scope="module")
def done(live: Any, clip: Clip) -> list[dict[str, Any]]:
    """Two finished jobs: a box that stands, and one that slides."""
    answers = [live.submit(clip(0.0), name="still.npz"), live.submit(clip(0.4), name="slides.npz")]
    return [live.wait(answer.json()["id"]) for answer in answers]


def error_of(answer: httpx.Response, status: int, code: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/json"
    body = answer.json()
    assert set(body) == {"error"}
    assert body["error"]["code"] == code
    assert body["error"]["message"].endswith((".", "?"))
    assert body["error"]["request_id"] == answer.headers["x-request-id"]
    detail: dict[str, Any] = body["error"]
    return detail


# ---- validation --------------------------------------------------------------------------------


def test_a_clip_is_judged(done: list[dict[str, Any]], live: Any) -> None:
    still, slides = done
    assert still["status"] == slides["status"] == "done"
    assert still["summary"]["passed"] is True
    assert slides["summary"]["passed"] is False
    assert still["progress"] == 1.0
    assert still["attempts"] == 1
    assert still["created"] <= still["started"] <= still["finished"]
    assert still["clip"]["name"] == "still.npz"
    assert still["model"] == {"id": live.box(), "name": "box.xml"}
    assert live.client.get(still["links"]["self"]).json() == still


@pytest.mark.parametrize(
    ("format_", "media", "holds"),
    [
        ("json", "application/json", '"physretarget/report/1"'),
        ("html", "text/html", "<!doctype html>"),
        ("sarif", "application/sarif+json", '"version": "2.1.0"'),
        ("junit", "application/xml", "<testsuite"),
        ("markdown", "text/markdown", "still.npz"),
        ("text", "text/plain", "still.npz"),
    ],
)
def test_reports_in_every_format(
    done: list[dict[str, Any]], live: Any, format_: str, media: str, holds: str
) -> None:
    answer = live.client.get(done[0]["links"]["report"], params={"format": format_})
    assert answer.status_code == 200
    assert answer.headers["content-type"].partition(";")[0] == media
    assert holds in answer.text
    # Names as the client gave them: where the server keeps files is nobody's business.
    assert str(live.service.home.folder) not in answer.text


def test_pages_can_reach_nothing(done: list[dict[str, Any]], live: Any) -> None:
    for place in (f"{done[0]['links']['report']}?format=html", done[0]["links"]["replay"]):
        answer = live.client.get(place)
        policy = answer.headers["content-security-policy"]
        assert "sandbox allow-scripts" in policy
        assert "allow-same-origin" not in policy
        assert "default-src 'none'" in policy
        assert "http:" not in policy


def test_a_validation_has_no_clip_to_give(done: list[dict[str, Any]], live: Any) -> None:
    error_of(live.client.get(done[0]["links"]["clip"]), 404, "not_found")


def test_nothing_is_left_of_the_input(done: list[dict[str, Any]], live: Any) -> None:
    assert not live.service.home.blob(done[0]["clip"]["sha256"]).exists()
    assert list(live.service.home.incoming.iterdir()) == []


def test_options_are_those_of_the_command_line(live: Any, clip: Clip) -> None:
    options = {"profile": "robot", "lowpass": 6, "ignore": ["MDL", "KIN001"],
               "thresholds": {"CON002": {}}, "severity": {"CON001": "warning"}}  # fmt: skip
    del options["thresholds"]
    job = live.wait(live.submit(clip(), data={"options": json.dumps(options)}).json()["id"])
    assert job["options"] == options
    report = live.client.get(job["links"]["report"]).json()
    assert report["settings"]["profile"] == "robot"
    assert report["settings"]["lowpass_hz"] == 6
    assert not any(c["code"].startswith("MDL") for c in report["coverage"])


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ("{", "options"),
        ("[]", "options"),
        ('{"fps": NaN}', "options"),
        ('{"speed": 3}', "options.speed"),
        ('{"fps": -1}', "options.fps"),
        ('{"fps": "30"}', "options.fps"),
        ('{"profile": "human"}', "options.profile"),
        ('{"select": ["XYZ"]}', "options"),
        ('{"thresholds": {"MDL001": {"no": 1}}}', "options"),
        ('{"thresholds": {"\\ud800": {"no": 1}}}', "options.thresholds"),
        ("[" * 10_000, "options"),
    ],
)
def test_options_that_make_no_sense(live: Any, clip: Clip, options: str, place: str) -> None:
    answer = live.submit(clip(), data={"options": options})
    assert error_of(answer, 422, "invalid")["field"].startswith(place)


def test_an_unknown_option_is_answered_with_those_there_are(live: Any, clip: Clip) -> None:
    error = error_of(live.submit(clip(), data={"options": '{"speed": 3}'}), 422, "invalid")
    assert "no option 'speed'" in error["message"]
    assert "lowpass" in error["message"]


def test_what_does_not_belong_together_is_refused(live: Any, clip: Clip) -> None:
    files = {"clip": ("a.npz", clip())}
    post = lambda **told: live.client.post("/api/v1/jobs", **told)  # noqa: E731
    error_of(post(files=files), 422, "invalid")  # no model
    error_of(post(data={"model": "lamp"}, files={"x": ("x", b"")}), 422, "invalid")
    error_of(post(data={"model": "lamp", "kind": "guess"}, files=files), 422, "invalid")
    error_of(post(data={"model": "lamp", "clip_id": "0" * 26}, files=files), 422, "invalid")
    error_of(post(data={"model": "0" * 26}, files=files), 404, "not_found")
    error_of(post(data={"model": "lamp", "character": "lamp"}, files=files), 422, "invalid")
    error_of(post(data={"model": "lamp", "clip_id": "\x00"}, files={"clip": ("", b"")}), 422,
             "invalid")  # fmt: skip
    error_of(post(data={"model": "lamp", "clip_id": "nope"}), 415, "unsupported_media_type")
    error_of(post(json={"model": "lamp"}), 415, "unsupported_media_type")


def test_a_clip_that_does_not_fit_fails_with_a_sentence(live: Any, clip: Clip) -> None:
    answer = live.submit(clip(), data={"model": "penguin"})
    job = live.wait(answer.json()["id"])
    assert job["status"] == "failed"
    assert job["error"]["code"] == "input"
    assert "box.npz" in job["error"]["message"]
    assert str(live.service.home.folder) not in job["error"]["message"]
    error_of(live.client.get(job["links"]["report"]), 409, "conflict")


def test_an_uploaded_model_for_this_job_only(live: Any, clip: Clip) -> None:
    before = set(live.service.home.models.iterdir())
    box = (Path(__file__).parent.parent / "suite" / "conftest.py").read_text()
    xml = box.partition('BOX = """')[2].partition('"""')[0].encode()
    answer = live.submit(clip(), data={"model": None}, files={"model_file": ("own.xml", xml)})
    assert answer.json()["model"] == {"id": None, "name": "own.xml"}
    assert live.wait(answer.json()["id"])["status"] == "done"
    assert set(live.service.home.models.iterdir()) == before


# ---- idempotency -------------------------------------------------------------------------------


def test_a_key_makes_one_job(live: Any, clip: Clip) -> None:
    headers = {"Idempotency-Key": "once"}
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: live.submit(clip(0.1), headers=headers), range(8)))
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1
    id = answers[0].json()["id"]
    assert answers[0].headers["location"] == f"/api/v1/jobs/{id}"
    live.wait(id)
    again = live.submit(clip(0.1), headers=headers)
    assert again.json()["id"] == id
    error_of(live.submit(clip(0.2), headers=headers), 409, "conflict")
    assert list(live.service.home.blobs.iterdir()) == []


def test_the_same_clip_again_and_again(live: Any, clip: Clip) -> None:
    """Jobs share its content on disk: it must neither go nor change under one that runs."""
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: live.submit(clip(0.07)), range(24)))
    jobs = [live.wait(answer.json()["id"]) for answer in answers]
    assert {job["status"] for job in jobs} == {"done"}, [job["error"] for job in jobs]
    assert len({job["id"] for job in jobs}) == 24


# ---- lists -------------------------------------------------------------------------------------


def test_pages_of_jobs(done: list[dict[str, Any]], live: Any) -> None:
    every = live.client.get("/api/v1/jobs", params={"limit": 200}).json()
    assert every["next"] is None
    found: list[str] = []
    cursor: str | None = None
    while True:
        params = {"limit": 3, **({"cursor": cursor} if cursor else {})}
        page = live.client.get("/api/v1/jobs", params=params).json()
        found += [job["id"] for job in page["items"]]
        cursor = page["next"]
        if cursor is None:
            break
    assert found == [job["id"] for job in every["items"]]
    assert found == sorted(found, reverse=True)
    only = live.client.get("/api/v1/jobs", params={"q": "SLIDES", "status": "done"}).json()
    assert [job["id"] for job in only["items"]] == [done[1]["id"]]


@pytest.mark.parametrize("query", ["limit=0", "limit=1000", "limit=x", "cursor=!", "status=x",
                                   "kind=x", "q=%00", "q=" + "x" * 300])  # fmt: skip
def test_queries_that_make_no_sense(live: Any, query: str) -> None:
    error_of(live.client.get(f"/api/v1/jobs?{query}"), 422, "invalid")


# ---- cancel and delete -------------------------------------------------------------------------


def test_a_running_job_is_cancelled_and_its_child_ends(live: Any) -> None:
    long = io.BytesIO()
    frames = 40_000
    qpos = np.zeros((frames, 7))
    qpos[:, 2], qpos[:, 3] = 0.1, 1.0
    np.savez(long, qpos=qpos, fps=np.array(30.0))
    id = live.submit(long.getvalue(), name="long.npz", data={"options": '{"fps": 30}'}).json()["id"]
    while live.client.get(f"/api/v1/jobs/{id}").json()["status"] == "queued":
        pass
    answer = live.client.post(f"/api/v1/jobs/{id}/cancel")
    assert answer.status_code == 200
    assert live.wait(id, 5)["status"] == "cancelled"
    assert live.client.post(f"/api/v1/jobs/{id}/cancel").json()["status"] == "cancelled"
    assert not any(live.service.home.job(id).iterdir())
    assert live.client.delete(f"/api/v1/jobs/{id}").status_code == 204
    error_of(live.client.get(f"/api/v1/jobs/{id}"), 404, "not_found")
    error_of(live.client.delete(f"/api/v1/jobs/{id}"), 404, "not_found")


def test_what_is_done_cannot_be_cancelled(done: list[dict[str, Any]], live: Any) -> None:
    error_of(live.client.post(done[0]["links"]["cancel"]), 409, "conflict")


# ---- events ------------------------------------------------------------------------------------


def events(live: Any, id: str, **headers: str) -> list[tuple[int, str, dict[str, Any]]]:
    found, current = [], {}
    with live.client.stream("GET", f"/api/v1/jobs/{id}/events", headers=headers) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            if not line and current:
                found.append((int(current["id"]), current["event"], json.loads(current["data"])))
                current = {}
            elif not line.startswith(":"):
                key, _, value = line.partition(": ")
                current[key] = value
    return found


def test_a_job_is_followed_to_its_end(live: Any, clip: Clip) -> None:
    id = live.submit(clip(0.3)).json()["id"]
    found = events(live, id)
    assert found[-1][1] == "done"
    assert found[-1][2] == live.client.get(f"/api/v1/jobs/{id}").json()
    assert all(name == "progress" for _, name, _ in found[:-1])
    numbers = [number for number, _, _ in found]
    assert numbers == sorted(set(numbers))
    # Who comes back after the end is told the end.
    again = events(live, id, **{"Last-Event-ID": str(numbers[-1])})
    assert [(name, job["id"]) for _, name, job in again] == [("done", id)]
    error_of(live.client.get(f"/api/v1/jobs/{'0' * 26}/events"), 404, "not_found")


# ---- comparison --------------------------------------------------------------------------------


def test_two_jobs_compared(done: list[dict[str, Any]], live: Any) -> None:
    still, slides = (job["id"] for job in done)
    worse = live.client.get("/api/v1/compare", params={"left": still, "right": slides}).json()
    assert worse["verdict"] == "worse"
    rows = {row["name"]: row for row in worse["measures"]}
    assert rows["skate_speed_max_m_s"]["change"] == "worse"
    assert rows["skate_speed_max_m_s"]["better"] == "lower"
    assert "new" in {row["change"] for row in worse["findings"]}
    better = live.client.get("/api/v1/compare", params={"left": slides, "right": still}).json()
    assert better["verdict"] == "fixed"
    assert {row["change"] for row in better["findings"]} <= {"fixed", "both"}


def test_two_replays_on_one_page(done: list[dict[str, Any]], live: Any) -> None:
    still, slides = (job["id"] for job in done)
    answer = live.client.get("/api/v1/compare/replay", params={"left": still, "right": slides})
    assert answer.status_code == 200
    assert "sandbox allow-scripts" in answer.headers["content-security-policy"]
    for side in ("left", "right"):
        text = answer.text.partition(f'id="motion/{side}">')[2].partition("</script>")[0]
        assert json.loads(text)["scene"]["figures"]
    assert "src=" not in answer.text.partition("<body>")[2].partition("<script")[0]


def test_a_comparison_is_made_once_and_one_at_a_time(
    done: list[dict[str, Any]], live: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    still, slides = (job["id"] for job in done)
    made: list[int] = []
    at_once = 0

    def slow(sides: Any) -> str:
        nonlocal at_once
        at_once += 1
        made.append(at_once)
        time.sleep(0.2)
        at_once -= 1
        return f"<!doctype html><p>{sides[0][0].id}"

    monkeypatch.setattr(routes_results, "side_by_side", slow)
    pairs = [(still, still), (slides, slides), (still, still), (slides, slides), (still, still)]

    def ask(pair: tuple[str, str]) -> httpx.Response:
        return httpx.get(
            f"{live.url}/api/v1/compare/replay",
            params={"left": pair[0], "right": pair[1]}, timeout=30,
        )  # fmt: skip

    with ThreadPoolExecutor(5) as threads:
        answers = list(threads.map(ask, pairs))
    assert [answer.status_code for answer in answers] == [200] * 5
    assert all(answer.text.endswith(pair[0]) for answer, pair in zip(answers, pairs, strict=True))
    assert made == [1, 1]
    assert all("sandbox" in answer.headers["content-security-policy"] for answer in answers)


# ---- clips and models --------------------------------------------------------------------------


def test_a_registered_clip_serves_many_jobs(live: Any, clip: Clip) -> None:
    made = live.client.post("/api/v1/clips", files={"file": ("dir/../böx.npz", clip(0.05))})
    assert made.status_code == 201
    entry = made.json()
    assert entry["name"] == "böx.npz"
    assert live.client.get(made.headers["location"]).json() == entry
    assert entry in live.client.get("/api/v1/clips", params={"q": "BÖX"}).json()["items"] or entry \
        in live.client.get("/api/v1/clips").json()["items"]  # fmt: skip
    for _ in range(2):
        answer = live.client.post(
            "/api/v1/jobs", data={"model": live.box(), "clip_id": entry["id"]},
            files={"x": ("", b"")},
        )  # fmt: skip
        assert answer.status_code == 422  # an unknown part is never ignored
    form = {"model": (None, live.box()), "clip_id": (None, entry["id"])}
    for _ in range(2):
        job = live.client.post("/api/v1/jobs", files=form).json()
        assert live.wait(job["id"])["status"] == "done"
    assert live.client.delete(f"/api/v1/clips/{entry['id']}").status_code == 204
    error_of(live.client.get(f"/api/v1/clips/{entry['id']}"), 404, "not_found")
    error_of(live.client.post("/api/v1/jobs", files=form), 404, "not_found")


def test_the_built_in_models_are_there(live: Any) -> None:
    items = live.client.get("/api/v1/models").json()["items"]
    assert [model["id"] for model in items[:3]] == ["lamp", "penguin", "squirrel"]
    assert all(model["builtin"] and model["mass_kg"] > 0 for model in items[:3])
    assert live.client.get("/api/v1/models/lamp").json() == items[0]
    error_of(live.client.delete("/api/v1/models/lamp"), 409, "conflict")
    error_of(live.client.get("/api/v1/models/nobody"), 404, "not_found")


def test_a_model_in_a_zip(live: Any, clip: Clip) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("robot/box.xml", '<mujoco><include file="parts/body.xml"/></mujoco>')
        archive.writestr(
            "robot/parts/body.xml",
            '<mujoco><worldbody><geom type="plane" size="5 5 .1"/><body pos="0 0 .1"><freejoint '
            'name="root"/><geom type="box" size=".2 .1 .1"/></body></worldbody></mujoco>',
        )
    answer = live.client.post(
        "/api/v1/models", files={"file": ("box.zip", content.getvalue())}, data={"name": "My box"}
    )
    assert answer.status_code == 201, answer.text
    model = answer.json()
    assert (model["name"], model["bodies"], model["joints"]) == ("My box", 1, 1)
    assert live.client.get(answer.headers["location"]).json() == model
    job = live.wait(live.submit(clip(), data={"model": model["id"]}).json()["id"])
    assert job["status"] == "done", job
    assert live.client.delete(f"/api/v1/models/{model['id']}").status_code == 204
    assert not (live.service.home.models / model["id"]).exists()


def test_which_model_in_a_zip_of_several(live: Any) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in ("a.xml", "b.xml"):
            archive.writestr(name, (MODELS / "lamp.xml").read_text())
    files = {"file": ("two.zip", content.getvalue())}
    told = error_of(live.client.post("/api/v1/models", files=files), 422, "unusable")
    assert "a.xml, b.xml" in told["message"]
    answer = live.client.post("/api/v1/models", files=files, data={"main": "b.xml"})
    assert answer.status_code == 201


# ---- retargeting -------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_capture_is_retargeted(live: Any, data: Path) -> None:
    capture = data / "bvh" / "bandai" / "dataset-1_walk_normal_001.bvh"
    answer = live.client.post(
        "/api/v1/jobs",
        data={"kind": "retarget", "character": "lamp", "options": '{"mapper": "nn3"}'},
        files={"capture": (capture.name, capture.read_bytes())},
    )
    found = events(live, answer.json()["id"])
    stages = [job["stage"] for _, _, job in found]
    assert found[-1][1] == "done", found[-1]
    # Which of them a listener sees depends on how fast they pass.
    assert {
        "read",
        "learn",
        "prepare",
        "map",
        "pose",
        "place",
        "contact",
        "physics",
        "judge",
        "report",
    } & set(stages)
    made = live.client.get(found[-1][2]["links"]["clip"])
    assert "walk_normal_001.npz" in made.headers["content-disposition"]
    with np.load(io.BytesIO(made.content)) as arrays:
        assert arrays["qpos"].ndim == 2
    again = live.submit(made.content, name="made.npz", data={"model": "lamp"})
    assert live.wait(again.json()["id"])["status"] == "done"


def test_a_strange_character_needs_key_poses(live: Any) -> None:
    answer = live.client.post(
        "/api/v1/jobs", data={"kind": "retarget", "character": live.box()},
        files={"capture": ("walk.bvh", b"HIERARCHY")},
    )  # fmt: skip
    assert error_of(answer, 422, "invalid")["field"] == "keyposes"


# ---- errors, health, metrics -------------------------------------------------------------------


def test_one_error_body(live: Any) -> None:
    error_of(live.client.get("/nothing"), 404, "not_found")
    error_of(live.client.get("/api/v1/jobs/xyz"), 422, "invalid")
    error_of(live.client.get(f"/api/v1/jobs/{'0' * 26}"), 404, "not_found")
    answer = live.client.put("/api/v1/jobs")
    error_of(answer, 405, "method_not_allowed")
    assert "GET" in answer.headers["allow"] or "POST" in answer.headers["allow"]


def test_a_fault_of_ours_tells_nothing(start: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    live = start()

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("secret")

    monkeypatch.setattr(live.service.queue, "page", fail)
    answer = live.client.get("/api/v1/jobs")
    error_of(answer, 500, "internal")
    assert "secret" not in answer.text
    live.close()


def test_health_and_metrics(live: Any, done: list[dict[str, Any]]) -> None:
    health = live.client.get("/health").json()
    assert health["status"] == "ok"
    assert health["workers"] == 2
    assert set(health["sandbox"]) == {"landlock", "seccomp"}
    text = live.client.get("/metrics").text
    assert 'physretarget_jobs_finished_total{kind="validate",status="done"}' in text
    assert 'route="/api/v1/jobs/{id}"' in text
    assert done[0]["id"] not in text


def test_every_answer_carries_the_headers(live: Any) -> None:
    for place in ("/health", "/nothing", "/api/v1/jobs", "/openapi.json"):
        headers = live.client.get(place, headers={"X-Request-ID": "mine-1"}).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-request-id"] == "mine-1"
        assert "access-control-allow-origin" not in headers
    odd = live.client.get("/health", headers={"X-Request-ID": "a b\t<script>"})
    assert "<" not in odd.headers["x-request-id"]
