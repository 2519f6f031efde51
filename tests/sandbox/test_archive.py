"""Unpacking: honest archives of every writer, dishonest ones refused whole."""

from __future__ import annotations

import io
import shutil
import subprocess
import zipfile
from pathlib import Path

import malicious
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.archive import unpack
from physretarget.sandbox.limits import Limits

# Archives that unpack well; the models in them are what is refused.
HONEST = {"no_model", "two_models"}
ZIPS = [
    c for c in malicious.CASES if c.filename == "model.zip" and c.content()[:2] in (b"PK", b"#!")
]


@pytest.mark.parametrize("case", ZIPS, ids=lambda c: c.name)
def test_refused_whole(case: malicious.Case, tmp_path: Path) -> None:
    if case.name in HONEST or case.name.startswith(("stl", "obj", "msh", "png", "hfield", "skin")):
        pytest.skip("the archive itself is honest")
    file, into = tmp_path / "a.zip", tmp_path / "in" / "to"
    file.write_bytes(case.content())
    with pytest.raises(InputError) as refused:
        unpack(file, into, Limits())
    assert not into.exists() or not any(into.iterdir())
    assert sorted(p.name for p in tmp_path.iterdir()) in (["a.zip"], ["a.zip", "in"])
    assert str(refused.value).endswith(".")


@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_python_archives(streamed: bool, method: int, tmp_path: Path) -> None:
    class Pipe(io.RawIOBase):
        def __init__(self, file: io.BytesIO) -> None:
            self.file = file

        def writable(self) -> bool:
            return True

        def write(self, content: bytes) -> int:  # type: ignore[override]
            return self.file.write(content)

    kept = io.BytesIO()
    with zipfile.ZipFile(Pipe(kept) if streamed else kept, "w", method) as archive:
        archive.mkdir("meshes")
        archive.writestr("model.xml", "<mujoco/>" * 1000)
        archive.writestr("meshes/ä.stl", b"x")
        archive.writestr("empty", b"")
    (tmp_path / "a.zip").write_bytes(kept.getvalue())
    files = unpack(tmp_path / "a.zip", tmp_path / "out", Limits())
    assert [str(f.relative_to(tmp_path / "out")) for f in files] == [
        "empty", "meshes/ä.stl", "model.xml",
    ]  # fmt: skip
    assert (tmp_path / "out" / "model.xml").read_text() == "<mujoco/>" * 1000
    assert (tmp_path / "out" / "model.xml").stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(shutil.which("zip") is None, reason="no zip program")
def test_info_zip_archives(tmp_path: Path) -> None:
    (tmp_path / "m" / "a").mkdir(parents=True)
    (tmp_path / "m" / "model.xml").write_text("<mujoco/>")
    (tmp_path / "m" / "a" / "b.stl").write_bytes(bytes(1000))
    subprocess.run(["zip", "-qr", "../m.zip", "."], cwd=tmp_path / "m", check=True)
    assert len(unpack(tmp_path / "m.zip", tmp_path / "out", Limits())) == 2


def test_archive_with_a_comment(tmp_path: Path) -> None:
    content = malicious.raw_zip(malicious.Raw(), comment=b"made by hand")
    (tmp_path / "a.zip").write_bytes(content)
    assert len(unpack(tmp_path / "a.zip", tmp_path / "out", Limits())) == 1


def test_not_into_a_full_folder(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(malicious.zipped(a=b"a"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "there").touch()
    with pytest.raises(ValueError, match="not empty"):
        unpack(tmp_path / "a.zip", tmp_path / "out", Limits())
    assert (tmp_path / "out" / "there").exists()


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(at=st.integers(0, 10_000), new=st.binary(min_size=1, max_size=8))
def test_damaged_archives_are_read_right_or_refused(at: int, new: bytes, tmp_path: Path) -> None:
    whole = malicious.zipped(**{"model.xml": b"<mujoco/>" * 50, "a/b.bin": bytes(range(256))})
    at %= len(whole)
    (tmp_path / "a.zip").write_bytes(whole[:at] + new + whole[at + len(new) :])
    out = tmp_path / "out"
    shutil.rmtree(out, ignore_errors=True)
    try:
        files = unpack(tmp_path / "a.zip", out, Limits())
    except (InputError, UnsafeInputError):
        assert not out.exists() or not any(out.iterdir())
    else:
        # Names may have changed, checked content has not.
        assert sorted(f.stat().st_size for f in files) == [256, 450]
