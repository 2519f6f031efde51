"""Models before MuJoCo: honest ones pass, and every word of MuJoCo's schema was looked at."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import malicious
import mujoco
import numpy as np
import pytest
from PIL import Image

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.bounds import numbers_of
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_model
from physretarget.sandbox.vocabulary import (
    ATTRIBUTES,
    ELEMENTS,
    FILE_ATTRIBUTES,
    FOLDER_ATTRIBUTES,
    REFUSED_ELEMENTS,
)

REPOSITORY = Path(__file__).resolve().parents[2]


def schema() -> dict[str, set[str]]:
    """Attributes of each element of the installed MuJoCo, by all its places together."""
    found: dict[str, set[str]] = {}
    tag = ""
    for line in mujoco.mj_printSchema(False, False).splitlines():
        start = re.match(r"\s*(?:\(world\))?(\w+)\s+\([!?*R]\)(.*)$", line)
        if start:
            tag, line = start[1], start[2]
        found.setdefault(tag, set()).update(line.split())
    return {tag: words for tag, words in found.items() if tag}


def test_every_word_of_the_schema_was_looked_at() -> None:
    found = schema()
    assert len(found) > 100
    assert set(found) - ELEMENTS - REFUSED_ELEMENTS == set()
    allowed = {word for tag, words in found.items() if tag in ELEMENTS for word in words}
    assert allowed - ATTRIBUTES == set()


def test_every_attribute_that_names_a_file_is_known() -> None:
    """What smells of a file is checked as one, or is listed here with why it is none."""
    harmless = {
        "dir",  # direction of a light
        "directional",
        "content_type",  # must be that of the name
        "strippath",  # a switch; both readings are checked
    }
    words = {w for tag, words in schema().items() if tag in ELEMENTS for w in words}
    suspicious = {w for w in words if re.search("file|dir|path|url|uri|content|source|plugin", w)}
    assert suspicious - harmless == FILE_ATTRIBUTES | FOLDER_ATTRIBUTES


@pytest.mark.parametrize("element", sorted(REFUSED_ELEMENTS | {"nonsense"}))
def test_refused_elements(element: str, tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(f"<mujoco><{element}/></mujoco>")
    with pytest.raises(UnsafeInputError):
        check_model(tmp_path, Path("m.xml"), Limits())


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
def test_our_models_pass(name: str) -> None:
    check_model(REPOSITORY / "models", Path(f"{name}.xml"), Limits())


def test_a_robot_passes(data: Path) -> None:
    for model in (data / "robot").glob("*.xml"):
        check_model(model.parent, Path(model.name), Limits())


FULL = """<?xml version="1.0" encoding="utf-8"?>
<!-- a comment -->
<mujoco model="full">
  <compiler meshdir="assets" texturedir="assets/pictures" angle="radian"/>
  <size memory="16M"/>
  <include file="parts/defaults.xml"/>
  <asset>
    <mesh name="a" file="tetra.obj"/>
    <mesh name="b" file="tetra.stl" content_type="model/stl"/>
    <texture name="t" type="2d" file="dot.png"/>
    <texture name="sky" type="skybox" builtin="gradient" width="512" height="3072"/>
    <hfield name="h" size="1 1 1 .1" file="hills.bin"/>
    <hfield name="p" size="1 1 1 .1" file="pictures/dot.png"/>
  </asset>
  <worldbody>
    <replicate count="10" offset="0 0 1"><site size=".01"/></replicate>
    <geom type="hfield" hfield="h"/>
    <body pos="0 0 1"><freejoint/><geom type="mesh" mesh="a"/><geom type="mesh" mesh="b"/></body>
  </worldbody>
</mujoco>"""


def full_model(folder: Path) -> Path:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    assets = folder / "assets"
    (assets / "pictures").mkdir(parents=True)
    (folder / "parts").mkdir()
    (assets / "tetra.obj").write_text(
        "# four\no t\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in vertices)
        + "vn 0 0 1\n" + "".join(f"f {a + 1}//1 {b + 1}//-1 {c - 4}//1\n" for a, b, c in faces)
    )  # fmt: skip
    triangles = b"".join(
        bytes(12) + vertices[face].astype("<f4").tobytes() + bytes(2) for face in faces
    )
    (assets / "tetra.stl").write_bytes(bytes(80) + struct.pack("<I", 4) + triangles)
    Image.effect_noise((40, 30), 50).save(assets / "pictures" / "dot.png", dpi=(72, 72))
    heights = np.linspace(0, 1, 12, dtype="<f4").tobytes()
    (assets / "hills.bin").write_bytes(struct.pack("<2i", 3, 4) + heights)
    (folder / "parts" / "defaults.xml").write_text(
        "<mujocoinclude><default><geom friction='1'/></default></mujocoinclude>"
    )
    (folder / "main.xml").write_text(FULL)
    return folder / "main.xml"


def test_a_full_model_passes_here_and_in_mujoco(tmp_path: Path) -> None:
    main = full_model(tmp_path)
    check_model(tmp_path, Path("main.xml"), Limits())
    model = mujoco.MjModel.from_xml_path(str(main))
    assert (model.nmesh, model.ntex, model.nhfield, model.nsite) == (2, 2, 2, 10)


def test_assets_above_the_model_but_inside_the_upload(tmp_path: Path) -> None:
    (tmp_path / "xml").mkdir()
    (tmp_path / "m.stl").write_bytes(malicious.stl(4))
    (tmp_path / "xml" / "m.xml").write_bytes(
        malicious.model("<compiler meshdir='..'/><asset><mesh file='m.stl'/></asset>")
    )
    check_model(tmp_path, Path("xml/m.xml"), Limits())
    with pytest.raises(UnsafeInputError, match="outside"):
        check_model(tmp_path / "xml", Path("m.xml"), Limits())


def test_links_are_refused(tmp_path: Path) -> None:
    secret = tmp_path / "secret.stl"
    secret.write_bytes(malicious.stl(4))
    upload = tmp_path / "upload"
    upload.mkdir()
    (upload / "m.xml").write_bytes(malicious.model("<asset><mesh file='m.stl'/></asset>"))
    (upload / "m.stl").symlink_to(secret)
    with pytest.raises(UnsafeInputError, match="neither a file nor a folder"):
        check_model(upload, Path("m.xml"), Limits())


def test_the_main_file_lies_inside(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "m.xml").write_bytes(malicious.MODEL)
    with pytest.raises(InputError, match="no model file"):
        check_model(tmp_path / "a", Path("../m.xml"), Limits())


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("1 -2.5 3e4", [1, -2.5, 3e4]),
        ("64M", [64 * 2**20]),
        ("0x10", [16]),
        ("inf", [np.inf]),
        ("-Infinity", [-np.inf]),
        ("0x1p9999", [np.inf]),
        ("word", None),
        ("1 word", None),
        ("", []),
    ],
)
def test_numbers(text: str, numbers: list[float] | None) -> None:
    assert numbers_of(text) == numbers


def test_nan_in_all_spellings() -> None:
    for text in ("nan", "-NaN", "nan(123)", "NAN"):
        assert np.isnan(numbers_of(text) or [0]).all(), text
