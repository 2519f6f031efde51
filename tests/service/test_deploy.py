"""What is deployed: the unit, the image's recipe, https, workers that end with their parent."""

from __future__ import annotations

import os
import re
import shutil
import signal
import ssl
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

ROOT = Path(__file__).parents[2]


def options_of(command: str) -> set[str]:
    return set(re.findall(r"--[a-z][a-z-]*", command))


def known_options() -> set[str]:
    done = subprocess.run(
        [sys.executable, "-m", "physretarget", "serve", "--help"], capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    return options_of(done.stdout)


def test_the_unit_is_sound(tmp_path: Path) -> None:
    """By systemd itself, with a program that is there."""
    verify = shutil.which("systemd-analyze")
    if verify is None:
        pytest.skip("no systemd on this machine")
    text = (ROOT / "deploy" / "physretarget.service").read_text()
    program = "/opt/physretarget/bin/physretarget"
    assert program in text
    unit = tmp_path / "physretarget.service"
    unit.write_text(text.replace(program, sys.executable).replace("User=physretarget\n", ""))
    done = subprocess.run(
        [verify, "verify", str(unit)], capture_output=True, text=True, check=False
    )
    mine = [line for line in done.stderr.splitlines() if unit.name in line]
    assert done.returncode == 0 or not mine, done.stderr


def test_unit_and_image_call_what_there_is() -> None:
    unit = (ROOT / "deploy" / "physretarget.service").read_text()
    command = next(line for line in unit.splitlines() if line.startswith("ExecStart"))
    image = (ROOT / "deploy" / "Dockerfile").read_text()
    served = image[image.index('CMD ["serve"') :]
    assert options_of(command) | options_of(served) <= known_options()


def test_the_image_is_not_roots_and_takes_only_the_package() -> None:
    text = (ROOT / "deploy" / "Dockerfile").read_text()
    last = text[text.rindex("\nFROM ") :]
    assert "USER physretarget" in last
    assert "HEALTHCHECK" in last
    assert last.index("USER physretarget") < last.index("ENTRYPOINT")
    for source in re.findall(r"^COPY (?!--from)(.*) ", text, flags=re.MULTILINE):
        for name in source.split():
            assert (ROOT / name).exists(), name
            assert f"!{name}" in (ROOT / ".dockerignore").read_text().split(), name


def test_it_speaks_https(tmp_path: Path, certificate: tuple[Path, Path]) -> None:
    cert, key = certificate
    child = subprocess.Popen(
        [sys.executable, "-m", "physretarget", "serve", "--data", str(tmp_path / "data"),
         "--port", "0", "--tls-cert", str(cert), "--tls-key", str(key), "--workers", "1"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        assert child.stdout is not None
        told = child.stdout.readline()
        port = int(re.search(r"https://[^ ]*:(\d+)", told)[1])  # type: ignore[index]
        trusted = ssl.create_default_context(cafile=str(cert))
        answer = httpx.get(f"https://localhost:{port}/health", verify=trusted)
        assert answer.json()["version"]
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"http://localhost:{port}/health")
    finally:
        child.terminate()
        assert child.wait(20) == 0


def test_a_key_without_its_certificate_is_refused(tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    key.write_text("x")
    done = subprocess.run(
        [sys.executable, "-m", "physretarget", "serve", "--data", str(tmp_path / "d"),
         "--tls-key", str(key)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "--tls-cert" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="by prctl")
def test_workers_of_a_killed_suite_end(tmp_path: Path) -> None:
    """With -9 nothing can be tidied up: the kernel has to end them."""
    script = tmp_path / "work.py"
    script.write_text(
        "import os, time\n"
        "from physretarget.suite.run import _pool\n"
        "if __name__ == '__main__':\n"
        "    with _pool(2) as pool:\n"
        "        found = {pool.submit(os.getpid).result() for _ in range(4)}\n"
        "        print(*found, flush=True)\n"
        "        pool.submit(time.sleep, 60).result()\n"
    )
    child = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    workers = [int(word) for word in child.stdout.readline().split()]
    assert workers
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    until = time.monotonic() + 10
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < until, "a worker outlives its suite"
        time.sleep(0.05)
