"""The client of the examples against a service that listens."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXAMPLE = Path(__file__).parents[2] / "examples" / "service_client.py"


def ask(*words: object) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key != "PHYSRETARGET_TOKEN"}
    return subprocess.run(
        [sys.executable, str(EXAMPLE), *map(str, words)],
        capture_output=True, text=True, check=False, timeout=120, env=environment,
    )  # fmt: skip


def test_the_client_says_the_verdict(live: Any, clip: Callable[..., bytes], tmp_path: Path) -> None:
    (tmp_path / "box.npz").write_bytes(clip())
    done = ask(live.url, tmp_path / "box.npz", live.box())
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] in {"passed", "failed", "not"}


def test_the_client_says_what_is_wrong(
    live: Any, clip: Callable[..., bytes], tmp_path: Path
) -> None:
    (tmp_path / "box.npz").write_bytes(clip())
    done = ask(live.url, tmp_path / "box.npz", "no-such-model")
    assert done.returncode == 1
    assert "model" in done.stderr
