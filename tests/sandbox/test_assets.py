"""Damaged meshes, pictures and models: a verdict or an InputError, nothing else."""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path

import malicious
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from physretarget.errors import InputError
from physretarget.sandbox.assets import check_asset
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_model

FUZZ = settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def picture(size: tuple[int, int], mode: str) -> bytes:
    content = io.BytesIO()
    Image.effect_noise(size, 50).convert(mode).save(content, "PNG")
    return content.getvalue()


WHOLE = {
    "m.stl": ("mesh", malicious.stl(4)),
    "m.obj": ("mesh", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1 -1//1\n"),
    "m.msh": ("mesh", struct.pack("<4i", 4, 0, 0, 2) + bytes(4 * 12 + 2 * 12)),
    "t.png": ("texture", picture((33, 17), "RGB")),
    "h.png": ("hfield", picture((33, 17), "L")),
    "h.bin": ("hfield", struct.pack("<2i", 2, 3) + np.zeros(6, "<f4").tobytes()),
    "s.skn": ("skin", struct.pack("<4i", 3, 0, 1, 0) + bytes(3 * 12 + 12)),
}


@pytest.mark.parametrize("name", WHOLE)
def test_whole_files_pass(name: str, tmp_path: Path) -> None:
    element, content = WHOLE[name]
    (tmp_path / name).write_bytes(content)
    check_asset(tmp_path / name, element, Limits())


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"])
@pytest.mark.parametrize("size", [(1, 1), (7, 300)])
def test_pictures_of_every_kind_pass(mode: str, size: tuple[int, int], tmp_path: Path) -> None:
    place = tmp_path / "t.png"
    Image.new(mode, size).save(place)
    check_asset(place, "texture", Limits())


@pytest.mark.parametrize("name", WHOLE)
@FUZZ
@given(at=st.integers(0, 10_000), new=st.binary(max_size=8), end=st.integers(0, 10_000))
def test_damaged_files(name: str, at: int, new: bytes, end: int, tmp_path: Path) -> None:
    element, content = WHOLE[name]
    at %= len(content)
    changed = content[:at] + new + content[at + len(new) :]
    (tmp_path / name).write_bytes(changed[: max(1, end % (2 * len(content)))])
    with contextlib.suppress(InputError):
        check_asset(tmp_path / name, element, Limits())


TEXT = (
    "<?xml version='1.0' encoding='utf-8'?><mujoco model='m'><size memory='1M'/><default>"
    "<geom friction='1 2 3'/></default><asset><texture name='t' builtin='flat' width='8' "
    "height='8'/></asset><worldbody><replicate count='3'><body><joint range='-1 1'/>"
    "<geom size='.1 nan'/></body></replicate><!-- é --></worldbody></mujoco>"
).encode()
WORDS = [
    b"<", b">", b"/", b"'", b"&", b"&#0;", b"&#xD800;", b"<![CDATA[", b"]]>", b"<!--", b"\0",
    b"\xff", b"\xed\xa0\x80", b"<?", b"<!DOCTYPE a>", b"1e999", b"99999999999", b"-1", b" ",
]  # fmt: skip


@settings(FUZZ, max_examples=500)
@given(changes=st.lists(st.tuples(st.integers(0, 500), st.integers(0, 6), st.sampled_from(WORDS))))
def test_damaged_models(tmp_path: Path, changes: list[tuple[int, int, bytes]]) -> None:
    text = TEXT
    for at, removed, word in changes:
        text = text[:at] + word + text[at + removed :]
    (tmp_path / "m.xml").write_bytes(text)
    with contextlib.suppress(InputError):
        check_model(tmp_path, Path("m.xml"), Limits())
