"""The API keeps to its own description, whatever is sent."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physretarget.service.tokens import hashed, make_token

# Bytes that are no clip are refused although the description, which can only say "a file",
# allows them.
CONFIG = """
[[operations]]
include-name = ["POST /api/v1/jobs", "POST /api/v1/clips", "POST /api/v1/models"]
checks.positive_data_acceptance.enabled = false
"""


def check(live: Any, tmp_path: Path, token: str, *more: str) -> None:
    config = tmp_path / "schemathesis.toml"
    config.write_text(CONFIG)
    ran = subprocess.run(
        [sys.executable, "-m", "schemathesis.cli", "--config-file", str(config), "run",
         f"{live.url}/openapi.json", "-H", f"Authorization: Bearer {token}", "--seed", "1",
         "--no-color", "--no-shrink", "--generation-database", "none", *more],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-6000:] + ran.stderr[-2000:]


@pytest.fixture(scope="module")
def guarded(start: Callable[..., Any], clip: Callable[..., bytes]) -> tuple[Any, str]:
    """A service with a token, some jobs and little patience, and the token."""
    live = start(limits={"upload_bytes": 2_000_000}, stranger_rate=0)
    for slide in (0.0, 0.3):
        live.wait(live.submit(clip(slide)).json()["id"])
    token = make_token()
    live.service.registry.add_token("fuzzer", "admin", hashed(token))
    # The server looks at the table every other second.
    until = time.monotonic() + 30
    while live.client.get("/api/v1/jobs").status_code != 401:
        assert time.monotonic() < until
        time.sleep(0.1)
    return live, token


def test_the_description_is_complete(live: Any) -> None:
    described = live.client.get("/openapi.json").json()
    assert described["info"]["title"] == "physretarget"
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            codes = set(operation["responses"])
            assert operation["description"], (method, path)
            if path.startswith("/api/"):
                assert {"401", "403", "429"} <= codes, (method, path)
                assert operation["security"], (method, path)
            for code in codes - {"200", "201", "202", "204"}:
                schema = operation["responses"][code]["content"]["application/json"]["schema"]
                # What is wrong is told in the same words as that nothing is.
                told = "/Health" if path == "/health/ready" and code == "503" else "/ErrorBody"
                assert schema["$ref"].endswith(told), (method, path, code)
    assert "http" not in json.dumps(described["paths"])


def test_no_answer_outside_the_description(guarded: tuple[Any, str], tmp_path: Path) -> None:
    check(*guarded[:1], tmp_path, guarded[1], "--phases", "examples,coverage",
          "--max-examples", "1")  # fmt: skip


@pytest.mark.slow
def test_no_answer_outside_the_description_for_long(
    guarded: tuple[Any, str], tmp_path: Path
) -> None:
    check(*guarded[:1], tmp_path, guarded[1], "--max-examples", "40")
