"""Whatever spelling of a path passes the check, MuJoCo opens nothing outside the upload."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path
from xml.sax.saxutils import quoteattr

import malicious
import mujoco
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from watch import Watch

from physretarget.errors import InputError
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_model

NAMES = ["m.stl", "t.png", "h.bin", "part.xml", "s.skn", "m.obj"]
PIECES = [
    "..", ".", "", "a", "out", "up", " ", "~", "...", "a\\..", "..\\..", "%2e%2e", "file:", "C:",
    "\u2024\u2024", "\uff0e\uff0e", "..\u200b", "x&#46;", "$HOME", "*",
]  # fmt: skip
paths = st.builds(
    lambda root, pieces, separator, name: root + separator.join([*pieces, name]),
    st.sampled_from(["", "/", "//", "./", "../", "\\", "FOLDER/", "FOLDER/../out/"]),
    st.lists(st.sampled_from(PIECES), max_size=4),
    st.sampled_from(["/", "//", "\\", "/./"]),
    st.sampled_from([*NAMES, *(name.upper() for name in NAMES)]),
)
folders = st.none() | paths.map(lambda path: path.rpartition("/")[0])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An upload with folders in it, and beside it and above it files of the same names."""
    place = tmp_path_factory.mktemp("place")
    upload = place / "up"
    for folder in (place, place / "out", upload, upload / "a", upload / "a" / "up"):
        folder.mkdir(exist_ok=True)
        (folder / "m.stl").write_bytes(malicious.stl(4))
        (folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
        (folder / "t.png").write_bytes(malicious.png(1, 1))
        (folder / "h.bin").write_bytes(bytes([2, 0, 0, 0, 2, 0, 0, 0]) + bytes(16))
        (folder / "s.skn").write_bytes(bytes(16))
        (folder / "part.xml").write_text("<mujocoinclude/>")
    return place


@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    kind=st.sampled_from(["mesh", "texture", "hfield", "skin", "include", "cube"]),
    path=paths, meshdir=folders, texturedir=folders, assetdir=folders, strip=st.booleans(),
    deeper=st.booleans(),
)  # fmt: skip
def test_nothing_outside_is_opened(
    place: Path, kind: str, path: str, meshdir: str | None, texturedir: str | None,
    assetdir: str | None, strip: bool, deeper: bool,
) -> None:  # fmt: skip
    def spelled(text: str) -> str:
        # Character references stay as written: the parsers resolve them.
        return quoteattr(text.replace("FOLDER", str(place))).replace("&amp;#46;", "&#46;")

    told = {"meshdir": meshdir, "texturedir": texturedir, "assetdir": assetdir}
    compiler = " ".join(f"{k}={spelled(v)}" for k, v in told.items() if v is not None)
    file = f"file={spelled(path)}"
    inside = {
        "mesh": f"<asset><mesh name='m' {file}/></asset>",
        "texture": f"<asset><texture name='t' type='2d' {file}/></asset>",
        "cube": f"<asset><texture name='t' type='cube' fileup={spelled(path)}/></asset>",
        "hfield": f"<asset><hfield name='h' size='1 1 1 1' {file}/></asset>",
        "skin": f"<deformable><skin name='s' {file}/></deformable>",
        "include": f"<include {file}/>",
    }[kind]
    upload = place / "up"
    main = upload / "a" / "main.xml" if deeper else upload / "main.xml"
    main.write_bytes(
        malicious.model(f"<compiler strippath='{str(strip).lower()}' {compiler}/>{inside}")
    )
    try:
        check_model(upload, main, Limits())
    except InputError:
        return
    watches = [Watch(place), Watch(place / "out")]
    with contextlib.suppress(ValueError, mujoco.FatalError):  # the files are hardly ones
        mujoco.MjModel.from_xml_path(str(main))
    for watch in watches:
        seen = [name for name in watch.seen() if name in NAMES]
        watch.close()
        assert seen == []


def test_the_upload_itself_is_opened(place: Path) -> None:
    """The test above sees what MuJoCo opens, and some spellings pass."""
    inside = place / "copy"
    shutil.copytree(place / "up", inside)
    (inside / "main.xml").write_bytes(
        malicious.model("<compiler meshdir='a'/><asset><mesh file='up/../m.stl'/></asset>")
    )
    check_model(inside, Path("main.xml"), Limits())
    watch = Watch(inside / "a")
    with pytest.raises(ValueError, match="vertices"):
        mujoco.MjModel.from_xml_path(str(inside / "main.xml"))
    assert "m.stl" in watch.seen()
    watch.close()
