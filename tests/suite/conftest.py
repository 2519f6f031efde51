"""A library that takes milliseconds: a box that stands, slides or sinks, and databases."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from glob import glob
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sqlalchemy", reason="the suite's history needs the extra 'suite'")

from physretarget.clip import Clip

BOX = """<mujoco model="box">
  <worldbody>
    <geom name="floor" type="plane" size="5 5 0.1"/>
    <body name="box" pos="0 0 0.1">
      <freejoint name="root"/>
      <geom name="box" type="box" size="0.2 0.1 0.1" density="500"/>
    </body>
  </worldbody>
</mujoco>
"""


def box_clip(path: Path, *, slide: float = 0.0, sink: float = 0.0, seconds: float = 1.0) -> None:
    """Write a box that stands, slides at m/s or stands m deep in the floor."""
    time = np.arange(round(30 * seconds) + 1) / 30.0
    qpos = np.zeros((len(time), 7))
    qpos[:, 0] = slide * time
    qpos[:, 2] = 0.1 - sink
    qpos[:, 3] = 1.0
    Clip(qpos=qpos, time=time, joint_names=("root",)).save(path)


class Library:
    """A folder with a model, clips and a suite file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = folder / "night.toml"
        (folder / "clips").mkdir(parents=True)
        (folder / "box.xml").write_text(BOX)
        for name in ("a", "b", "c"):
            self.clip(name)
        self.clip("bad", sink=0.08)
        self.file.write_text(
            '[suite]\nname = "night"\n\n[[case]]\nclips = ["clips/*.npz"]\nmodel = "box.xml"\n'
            'tags = ["boxes"]\nowner = "me"\n'
        )

    def clip(self, name: str, *, slide: float = 0.0, sink: float = 0.0) -> None:
        # Lengths differ, or clips of equal content would share one result.
        box_clip(self.path(name), slide=slide, sink=sink, seconds=1.0 + 0.1 * len(name)
                 + 0.2 * (ord(name[0]) - 97))  # fmt: skip

    def path(self, name: str) -> Path:
        return self.folder / "clips" / f"{name}.npz"


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(tmp_path / "library")


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database of each kind."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'history.sqlite'}"
    server = request.getfixturevalue("postgresql")
    name = f"t{abs(hash(str(tmp_path)))}"
    _psql(server, f"CREATE DATABASE {name}")
    return f"{server}/{name}"


def _psql(server: str, statement: str) -> None:
    import psycopg

    address = server.replace("postgresql+psycopg", "postgresql") + "/postgres"
    with psycopg.connect(address, autocommit=True) as connection:
        connection.execute(statement)  # type: ignore[call-overload]


@pytest.fixture(scope="session")
def postgresql() -> Iterator[str]:
    """URL of a PostgreSQL server without a database: $PHYSRETARGET_TEST_POSTGRESQL or our own."""
    pytest.importorskip("psycopg", reason="PostgreSQL needs the extra 'postgresql'")
    told = os.environ.get("PHYSRETARGET_TEST_POSTGRESQL")
    if told:
        yield told.rstrip("/")
        return
    found = sorted(glob("/usr/lib/postgresql/*/bin/initdb"))
    program = shutil.which("initdb") or (found[-1] if found else None)
    if program is None:
        pytest.skip("PostgreSQL is not installed (Debian's package postgresql)")
    bin_ = Path(program).parent
    folder = Path(tempfile.mkdtemp(prefix="pg-"))
    user: list[str] = []
    if os.geteuid() == 0:  # the server refuses to run as root
        if shutil.which("runuser") is None:
            pytest.skip("PostgreSQL does not run as root, and runuser is not there")
        shutil.chown(folder, "postgres")
        user = ["runuser", "-u", "postgres", "--"]
    data, port = folder / "data", _free_port()
    options = f"-p {port} -c listen_addresses=127.0.0.1 -k {folder} -c fsync=off"
    run = {"check": True, "cwd": "/", "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([*user, str(bin_ / "initdb"), "-D", str(data), "-A", "trust", "-U", "tests"],
                   **run)  # type: ignore[call-overload] # fmt: skip
    control = [*user, str(bin_ / "pg_ctl"), "-D", str(data), "-w"]
    subprocess.run([*control, "-o", options, "-l", str(folder / "log"), "start"], **run)  # type: ignore[call-overload]
    try:
        yield f"postgresql+psycopg://tests@127.0.0.1:{port}"
    finally:
        subprocess.run([*control, "-m", "immediate", "stop"], **run)  # type: ignore[call-overload]
        shutil.rmtree(folder, ignore_errors=True)


def _free_port() -> int:
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
