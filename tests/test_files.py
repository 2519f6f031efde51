"""Writing: whole or not at all, and never a file in the place of something else."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import pytest

from physretarget.errors import InputError
from physretarget.files import write_file


def test_a_file_is_whole_and_nothing_stays_beside_it(tmp_path: Path) -> None:
    place = tmp_path / "new" / "report.json"
    write_file(place, b"one")
    write_file(place, b"two")
    assert place.read_bytes() == b"two"
    assert [p.name for p in place.parent.iterdir()] == ["report.json"]


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    heard: list[bytes] = []
    listener = threading.Thread(target=lambda: heard.append(pipe.read_bytes()), daemon=True)
    listener.start()
    write_file(pipe, b"said")
    listener.join(10)
    assert heard == [b"said"]
    assert stat.S_ISFIFO(pipe.lstat().st_mode)


def test_a_device_stays_a_device(tmp_path: Path) -> None:
    """Renaming a file onto it would take ``/dev/null`` from the whole machine, as root."""
    link = tmp_path / "nowhere"
    link.symlink_to(os.devnull)
    write_file(link, b"gone")
    assert link.is_symlink()
    assert stat.S_ISCHR(link.stat().st_mode)
    assert [p.name for p in tmp_path.iterdir()] == ["nowhere"]


def test_what_a_link_leads_to_is_written(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "latest.json"
    real.write_bytes(b"old")
    link.symlink_to("real.json")
    write_file(link, b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"


def test_a_folder_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_file(tmp_path / "here", b"no")
    assert [p.name for p in tmp_path.iterdir()] == ["here"]
