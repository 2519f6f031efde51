"""A service over loopback with warm children shared by all tests, and things to send."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="the service needs the extra 'service'")
pytest.importorskip("fastapi", reason="the service needs the extra 'service'")
pytest.importorskip("prometheus_client", reason="the service needs the extra 'service'")

import httpx

from physretarget.listen import listen
from physretarget.sandbox.pool import Pool
from physretarget.service.app import create_app
from physretarget.service.server import Server, configuration
from physretarget.service.service import Service
from physretarget.service.settings import Settings


def _module(path: Path) -> ModuleType:
    """Another file of the tests as a module; they are no package."""
    spec = importlib.util.spec_from_file_location(f"service_{path.stem}_{path.parent.name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


_suite = _module(Path(__file__).parent.parent / "suite" / "conftest.py")
postgresql = _suite.postgresql
url = _suite.url
BOX: str = _suite.BOX


@pytest.fixture(scope="session")
def drills() -> ModuleType:
    """The benchmark that kills servers."""
    return _module(Path(__file__).parent.parent.parent / "benchmarks" / "service.py")


@pytest.fixture(scope="session")
def malicious() -> ModuleType:
    """Uploads that try something."""
    module = _module(Path(__file__).parent.parent / "sandbox" / "malicious.py")
    module.write_canaries()
    return module


@pytest.fixture(scope="session")
def pool() -> Iterator[Pool]:
    """Warm children: importing everything takes seconds, once."""
    with Pool(("physretarget.service.tasks",)) as made:
        made.start()
        yield made


class Live:
    """A service that listens, and a client of it."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self._listening = listen("127.0.0.1", 0)
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        config = configuration(create_app(service), service.settings)
        self.server = Server(config, lambda: None, service)
        self._thread = threading.Thread(
            target=self.server.run, kwargs={"sockets": [self._listening]}
        )
        self._thread.start()
        while not self.server.started:
            assert self._thread.is_alive()
            time.sleep(0.01)
        self.client = httpx.Client(base_url=self.url, timeout=30)

    def close(self) -> None:
        self.client.close()
        self.server.should_exit = True
        self._thread.join()
        self._listening.close()

    # ---- what tests do most ----------------------------------------------------------------

    def submit(self, clip: bytes, *, name: str = "box.npz", **more: Any) -> httpx.Response:
        """Submit a clip of the box with the model that :meth:`box` registers."""
        data = {"model": self.box(), **more.pop("data", {})}
        data = {key: value for key, value in data.items() if value is not None}
        files = {"clip": (name, clip), **more.pop("files", {})}
        return self.client.post("/api/v1/jobs", data=data, files=files, **more)

    def box(self) -> str:
        """The id of a registered box."""
        if not hasattr(self, "_box"):
            answer = self.client.post("/api/v1/models", files={"file": ("box.xml", BOX.encode())})
            assert answer.status_code == 201, answer.text
            self._box = answer.json()["id"]
        return self._box

    def wait(self, id: str, seconds: float = 30.0) -> dict[str, Any]:
        """The job when it has ended."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            job: dict[str, Any] = self.client.get(f"/api/v1/jobs/{id}").json()
            if job["status"] in ("done", "failed", "cancelled"):
                return job
            time.sleep(0.03)
        raise AssertionError(f"still {job['status']} ({job['stage']}) after {seconds} s")


@pytest.fixture(scope="session")
def start(pool: Pool, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Live]]:
    """Start services; settings by name."""
    made: list[Live] = []

    def begin(data: Path | None = None, **told: Any) -> Live:
        limits = told.pop("limits", {})
        settings = Settings(
            data=data or tmp_path_factory.mktemp("data"), rate=told.pop("rate", 0), **told
        )
        settings = replace(settings, limits=replace(settings.limits, **limits))
        made.append(Live(Service(settings, pool)))
        return made[-1]

    yield begin
    for live in made:
        if not live.server.should_exit:
            live.close()


@pytest.fixture(scope="session")
def live(start: Callable[..., Live]) -> Live:
    """One service for all tests that leave it as it was."""
    return start()


@pytest.fixture(scope="session")
def clip(drills: ModuleType) -> Callable[..., bytes]:
    """Bytes of a box that stands, or slides at m/s."""
    made: Callable[..., bytes] = drills.box_clip
    return made


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("no openssl on this machine")
    cert, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    subprocess.run(
        [openssl, "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj",
         "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-keyout", key, "-out", cert],
        check=True, capture_output=True,
    )  # fmt: skip
    return cert, key
