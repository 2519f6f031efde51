"""Uploads that try to reach, to run or to exhaust something: what each tries, and its bytes.

``CASES`` is for tests. As a program it writes them as files, to try them on a running service:

    python tests/sandbox/malicious.py FOLDER

``outside`` stands in paths for a file that must not be read; its content is :data:`CANARY`.
"""

from __future__ import annotations

import io
import json
import pickle
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

CANARY = "canary-5a1f0c: nobody may read this"
OUTSIDE = "/tmp/physretarget-canary/outside"  # also with an ending that a reader wants
MIB = 2**20


@dataclass(frozen=True)
class Case:
    """One upload: where it goes, what it tries."""

    name: str
    kind: Literal["model", "clip", "capture"]
    filename: str
    tries: str
    content: Callable[[], bytes]

    @property
    def options(self) -> dict[str, Any]:
        """What has to be told with the clip, so that nothing is missing but honesty."""
        return {"fps": 30.0} if self.filename.endswith((".csv", ".npy")) else {}


CASES: list[Case] = []


def case(kind: Literal["model", "clip", "capture"], filename: str, tries: str) -> Any:
    def add(make: Callable[[], bytes]) -> Callable[[], bytes]:
        CASES.append(Case(make.__name__.strip("_"), kind, filename, tries, make))
        return make

    return add


def write_canaries() -> Path:
    """Make the files outside that nothing may read; returns their folder."""
    outside = Path(OUTSIDE)
    outside.parent.mkdir(parents=True, exist_ok=True)
    for suffix in ("", ".xml", ".stl", ".png", ".bin", ".skn", ".obj"):
        outside.with_suffix(suffix).write_text(CANARY)
    return outside.parent


# ---- zip files -----------------------------------------------------------------------------------

MODEL = b"<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


@dataclass(kw_only=True)
class Raw:
    """One member of an archive, with every field open to a lie."""

    name: bytes = b"model.xml"
    content: bytes = MODEL
    packed: bytes | None = None
    method: int = 0
    flags: int = 0
    size: int | None = None  # in both headers
    directory_size: int | None = None
    local_name: bytes | None = None
    attributes: int = 0o100644 << 16
    offset: int | None = None
    crc: int | None = None
    hidden: bool = False  # has no local header of its own
    system: int = 3
    extra: bytes = field(default=b"")


def raw_zip(
    *members: Raw, before: bytes = b"", after: bytes = b"", comment: bytes = b"",
    count: int | None = None, disk: int = 0, zip64: bool = False,
) -> bytes:  # fmt: skip
    out = bytearray(before)
    directory = bytearray()
    for m in members:
        packed = m.content if m.packed is None else m.packed
        size = len(m.content) if m.size is None else m.size
        crc = zlib.crc32(m.content) if m.crc is None else m.crc
        local = m.name if m.local_name is None else m.local_name
        at = len(out) if m.offset is None else m.offset
        if not m.hidden:
            out += struct.pack("<4s5H3I2H", b"PK\3\4", 20, m.flags, m.method, 0, 33, crc,
                               len(packed), size, len(local), 0) + local + packed  # fmt: skip
        told = size if m.directory_size is None else m.directory_size
        directory += struct.pack(
            "<4s4B4H3I5H2I", b"PK\1\2", 20, m.system, 20, 0, m.flags, m.method, 0, 33, crc,
            len(packed), told, len(m.name), len(m.extra), 0, 0, 0, m.attributes, at,
        ) + m.name + m.extra  # fmt: skip
    start = len(out)
    out += directory
    number = len(members) if count is None else count
    if zip64:
        end64 = len(out)
        out += struct.pack("<4sQ2H2I4Q", b"PK\6\6", 44, 45, 45, 0, 0, number, number,
                           len(directory), start)  # fmt: skip
        out += struct.pack("<4sIQI", b"PK\6\7", 0, end64, 1)
    out += struct.pack("<4s4H2IH", b"PK\5\6", disk, disk, number & 0xFFFF, number & 0xFFFF,
                       len(directory), start, len(comment)) + comment  # fmt: skip
    return bytes(out + after)


def deflated(content: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(content) + packer.flush()


def zeros(megabytes: int, before: bytes = b"") -> bytes:
    """So many megabytes of zeros, deflated without ever holding or packing them."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packer.compress(before) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(MIB)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + block * megabytes + b"\x03\x00"


def zipped(**files: bytes | str) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def named(name: bytes, **fields: Any) -> bytes:
    return raw_zip(Raw(), Raw(name=name, content=b"evil", **fields))


def zip_case(tries: str) -> Any:
    return case("model", "model.zip", tries)


@zip_case("write above the folder by ..")
def traversal() -> bytes:
    return named(b"../../evil.xml")


@zip_case("write above the folder by .. in the middle")
def traversal_in_the_middle() -> bytes:
    return named(b"a/../../../evil.xml")


@zip_case("write to an absolute path")
def absolute() -> bytes:
    return named(b"/tmp/evil.xml")


@zip_case("write to another drive")
def drive_letter() -> bytes:
    return named(b"C:evil.xml")


@zip_case("write above the folder by backslashes")
def backslashes() -> bytes:
    return named(b"..\\..\\evil.xml")


@zip_case("end the name early by a NUL, so that two readers see two names")
def nul_in_name() -> bytes:
    return named(b"model.xml\0.txt", local_name=b"model.xml\0.txt")


@zip_case("colour a terminal, or hide the ending, by control characters")
def control_characters() -> bytes:
    return named(b"\x1b[2Jmodel.xml")


@zip_case("hide the ending by turning the writing direction")
def turned_name() -> bytes:
    return named("mod\u202elmx.exe".encode(), flags=0x800)


@zip_case("read a file outside through a symbolic link")
def symlink() -> bytes:
    return raw_zip(
        Raw(), Raw(name=b"link.stl", content=OUTSIDE.encode(), attributes=0o120777 << 16)
    )


@zip_case("write through a linked folder")
def symlinked_folder() -> bytes:
    return raw_zip(
        Raw(name=b"out", content=b"/tmp", attributes=0o120777 << 16), Raw(name=b"out/evil.xml")
    )


@zip_case("make a device")
def device() -> bytes:
    return named(b"mem", attributes=0o020666 << 16)


@zip_case("make a pipe that blocks whoever opens it")
def pipe() -> bytes:
    return named(b"pipe.xml", attributes=0o010666 << 16)


@zip_case("two members of one name: checked one, used the other")
def twice() -> bytes:
    return raw_zip(Raw(), Raw(content=b"<mujoco><evil/></mujoco>"))


@zip_case("two members whose names differ in case only")
def twice_by_case() -> bytes:
    return raw_zip(Raw(), Raw(name=b"MODEL.XML", content=b"evil"))


@zip_case("two members whose names are one after Unicode normalisation")
def twice_by_unicode() -> bytes:
    return raw_zip(
        Raw(),
        Raw(name="é.stl".encode(), flags=0x800),
        Raw(name="e\u0301.stl".encode(), flags=0x800),
    )


@zip_case("a name that is a file and a folder")
def file_and_folder() -> bytes:
    return raw_zip(Raw(), Raw(name=b"a"), Raw(name=b"a/b"))


@zip_case("a member that lies within the data of another, so that bytes count twice")
def overlapping() -> bytes:
    inner = raw_zip(Raw(name=b"b.bin", content=b"b" * 1000))
    local = inner[: 30 + 5 + 1000]
    outer = Raw(name=b"a.bin", content=local)
    return raw_zip(outer, Raw(name=b"b.bin", content=b"b" * 1000, hidden=True, offset=30 + 5))


@zip_case("a hundred members that all are the first")
def repeated() -> bytes:
    packed = zeros(4)
    first = Raw(name=b"0.bin", packed=packed, size=4 * MIB, method=8, crc=0)
    others = [
        Raw(name=b"%d.bin" % n, packed=packed, size=4 * MIB, method=8, crc=0, offset=0, hidden=True)
        for n in range(1, 100)
    ]
    return raw_zip(first, *others)


@zip_case("archives in an archive, five deep, each ten times the last (42.zip)")
def nested() -> bytes:
    content = zipped(**{"0.bin": bytes(MIB)})
    for _ in range(5):
        content = zipped(**{f"{n}.zip": content for n in range(10)})
    return content


@zip_case("four hundred megabytes of zeros in as many kilobytes")
def bomb() -> bytes:
    return raw_zip(
        Raw(), Raw(name=b"zeros.bin", packed=zeros(400), size=400 * MIB, method=8, crc=0)
    )


@zip_case("a member that claims more than a disk holds")
def large_claim() -> bytes:
    return raw_zip(Raw(), Raw(name=b"a.bin", content=b"a", size=2**32 - 2, crc=0))


@zip_case("many members, each just below the ratio that is looked at, much together")
def many_small_bombs() -> bytes:
    packed = zeros(3)
    return raw_zip(
        Raw(), *(Raw(name=b"%d.bin" % n, packed=packed, size=3 * MIB, method=8) for n in range(150))
    )


@zip_case("claim fewer bytes than there are")
def false_size() -> bytes:
    content = bytes(8 * MIB)
    return raw_zip(Raw(), Raw(name=b"a.bin", packed=deflated(content), size=1000, method=8, crc=0))


@zip_case("claim one size in the directory, another before the data")
def two_sizes() -> bytes:
    return raw_zip(Raw(directory_size=10))


@zip_case("one name in the directory, another before the data")
def two_names() -> bytes:
    return raw_zip(Raw(local_name=b"other.xml"))


@zip_case("encrypted")
def encrypted() -> bytes:
    return raw_zip(Raw(flags=1))


@zip_case("compressed by a method with no bound on its ratio (LZMA)")
def lzma_member() -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("model.xml", MODEL)
    return content.getvalue()


@zip_case("compressed by a method that nobody knows")
def unknown_method() -> bytes:
    return raw_zip(Raw(method=99))


@zip_case("zip64 records that claim more than the plain ones")
def zip64() -> bytes:
    return raw_zip(Raw(), zip64=True)


@zip_case("a hundred thousand empty members")
def many_members() -> bytes:
    return raw_zip(*(Raw(name=b"%d" % n, content=b"") for n in range(60_000)))


@zip_case("few members by the end record, a directory of many")
def false_count() -> bytes:
    return raw_zip(*(Raw(name=b"%d" % n, content=b"") for n in range(20_000)), count=1)


@zip_case("a name of sixty thousand bytes")
def long_name() -> bytes:
    return named(b"a" * 60_000)


@zip_case("a thousand folders deep")
def deep_folders() -> bytes:
    return named(b"a/" * 1000 + b"b")


@zip_case("something before the archive, so that it is two kinds of file at once")
def prepended() -> bytes:
    return raw_zip(Raw(), before=b"#!/bin/sh\nexit\n")


@zip_case("something after the archive")
def appended() -> bytes:
    return raw_zip(Raw(), after=b"evil" * 100)


@zip_case("another archive in the comment, which some readers see instead")
def two_ends() -> bytes:
    return raw_zip(Raw(), comment=raw_zip(Raw(content=b"<mujoco><plugin/></mujoco>")) + b"x")


@zip_case("an empty archive")
def empty_archive() -> bytes:
    return raw_zip()


@zip_case("cut off in the middle")
def cut_off() -> bytes:
    return raw_zip(Raw(content=MODEL * 100))[:2000]


@zip_case("content that its checksum denies")
def wrong_checksum() -> bytes:
    return raw_zip(Raw(crc=1))


@zip_case("one part of an archive in several")
def several_disks() -> bytes:
    return raw_zip(Raw(), disk=3)


@zip_case("a name that is a device elsewhere")
def device_name() -> bytes:
    return named(b"AUX.xml")


@zip_case("no model at all")
def no_model() -> bytes:
    return zipped(**{"readme.txt": b"hello"})


@zip_case("two models and no word which")
def two_models() -> bytes:
    return zipped(**{"a.xml": MODEL, "b.xml": MODEL})


@zip_case("a member that lies in the directory")
def member_in_directory() -> bytes:
    return raw_zip(Raw(), Raw(name=b"x", hidden=True, offset=140))


# ---- XML -----------------------------------------------------------------------------------------


def xml_case(tries: str) -> Any:
    return case("model", "model.xml", tries)


def model(inside: str = "", *, world: str = "", head: str = "") -> bytes:
    return (
        f"{head}<mujoco>{inside}<worldbody><body><freejoint/><geom size='.1'/></body>{world}"
        "</worldbody></mujoco>"
    ).encode()


def with_files(inside: str, **files: bytes | str) -> bytes:
    return zipped(**{"model.xml": model(inside), **files})


@xml_case("a billion laughs: entities that expand tenfold ten times")
def billion_laughs() -> bytes:
    entities = "<!ENTITY a0 'ha'>" + "".join(
        f"<!ENTITY a{n} '{f'&a{n - 1};' * 10}'>" for n in range(1, 11)
    )
    return model("<custom><text name='x' data='&a10;'/></custom>",
                 head=f"<!DOCTYPE mujoco [{entities}]>")  # fmt: skip


@xml_case("read a file by an external entity")
def external_entity() -> bytes:
    return model(
        "<custom><text name='x' data='y'/></custom>&x;",
        head=f"<!DOCTYPE mujoco [<!ENTITY x SYSTEM 'file://{OUTSIDE}'>]>",
    )


@xml_case("load a document type from elsewhere")
def external_dtd() -> bytes:
    return model(head="<!DOCTYPE mujoco SYSTEM 'http://127.0.0.1:1/evil.dtd'>")


@xml_case("a parameter entity")
def parameter_entity() -> bytes:
    return model(head=f"<!DOCTYPE mujoco [<!ENTITY % x SYSTEM '{OUTSIDE}'> %x;]>")


@xml_case("a processing instruction")
def processing_instruction() -> bytes:
    return model("<?php system('id') ?>")


@xml_case("read a file by XInclude")
def xinclude() -> bytes:
    return model(
        "<xi:include xmlns:xi='http://www.w3.org/2001/XInclude' parse='text' "
        f"href='file://{OUTSIDE}'/>"
    )


@xml_case("a coding that one reader follows and another does not (UTF-16)")
def utf16() -> bytes:
    return model("<plugin/>", head="<?xml version='1.0' encoding='UTF-16'?>").decode().encode(
        "utf-16"
    )  # fmt: skip


@xml_case("a coding in which tags hide (UTF-7)")
def utf7() -> bytes:
    return model("+ADw-plugin/+AD4-", head="<?xml version='1.0' encoding='UTF-7'?>")


@xml_case("bytes that are no UTF-8")
def not_utf8() -> bytes:
    return model("<custom><text name='x' data='\xff'/></custom>").decode().encode("latin-1")


@xml_case("a NUL, after which one reader sees nothing")
def nul_in_xml() -> bytes:
    return model() + b"\0<evil/>"


@xml_case("elements nested a hundred thousand deep")
def deep_xml() -> bytes:
    n = 100_000
    return model(world="<body>" * n + "</body>" * n)


@xml_case("a million elements")
def many_elements() -> bytes:
    return model(world="<site/>" * 1_000_000)


@xml_case("an XML of thirty megabytes")
def large_xml() -> bytes:
    return model("<!--" + "x" * (30 * MIB) + "-->")


@xml_case("one attribute of ten megabytes")
def long_attribute() -> bytes:
    return model(f"<custom><text name='x' data='{'x' * (10 * MIB)}'/></custom>")


@xml_case("a hundred thousand attributes")
def many_attributes() -> bytes:
    return model("<custom><text " + " ".join(f"a{n}='1'" for n in range(100_000)) + "/></custom>")


@xml_case("a word that nobody has looked at")
def unknown_word() -> bytes:
    return model("<asset><mesh name='m' source='/etc/passwd'/></asset>")


@xml_case("a file that includes itself")
def include_itself() -> bytes:
    return with_files("<include file='model.xml'/>")


@xml_case("two files that include each other")
def include_loop() -> bytes:
    part = "<mujocoinclude><include file='{}'/></mujocoinclude>"
    return with_files(
        "<include file='parts/a.xml'/>",
        **{"parts/a.xml": part.format("b.xml"), "parts/b.xml": part.format("a.xml")},
    )


@xml_case("a chain of a hundred files")
def include_chain() -> bytes:
    files = {
        f"parts/{n}.xml": f"<mujocoinclude><include file='{n + 1}.xml'/></mujocoinclude>"
        for n in range(100)
    }
    return with_files(
        "<include file='parts/0.xml'/>", **files, **{"parts/100.xml": "<mujocoinclude/>"}
    )


@xml_case("include a file above the upload")
def include_above() -> bytes:
    return with_files(f"<include file='../../../../../..{OUTSIDE}.xml'/>")


@xml_case("include a file by its absolute path")
def include_absolute() -> bytes:
    return model(f"<include file='{OUTSIDE}.xml'/>")


@xml_case("a mesh by its absolute path")
def mesh_absolute() -> bytes:
    return model(f"<asset><mesh name='m' file='{OUTSIDE}.stl'/></asset>")


@xml_case("a mesh above the upload, spelled with character references")
def mesh_above() -> bytes:
    return model("<asset><mesh name='m' file='&#46;&#x2e;/../outside.stl'/></asset>")


@xml_case("a folder of meshes outside")
def mesh_folder() -> bytes:
    return model(
        f"<compiler meshdir='{Path(OUTSIDE).parent}'/><asset><mesh file='outside.stl'/></asset>"
    )


@xml_case("a folder of assets outside, by ..")
def asset_folder() -> bytes:
    return with_files(
        f"<compiler assetdir='../../../../../../..{Path(OUTSIDE).parent}'/>"
        "<asset><mesh file='outside.stl'/></asset>", **{"outside.stl": stl(1)}
    )  # fmt: skip


@xml_case("a file outside that strippath would bring inside")
def strippath() -> bytes:
    return with_files(
        f"<compiler strippath='true'/><asset><mesh file='{OUTSIDE}.stl'/></asset>",
        **{"outside.stl": stl(1)},
    )


@xml_case("a picture outside")
def texture_outside() -> bytes:
    return model(f"<asset><texture name='t' type='2d' file='{OUTSIDE}.png'/></asset>")


@xml_case("one side of a cube of pictures outside")
def cube_side_outside() -> bytes:
    return model(f"<asset><texture name='t' type='cube' fileback='{OUTSIDE}.png'/></asset>")


@xml_case("a height field outside")
def hfield_outside() -> bytes:
    return model(f"<asset><hfield name='h' size='1 1 1 1' file='{OUTSIDE}.bin'/></asset>")


@xml_case("a skin outside")
def skin_outside() -> bytes:
    return model(f"<deformable><skin name='s' file='{OUTSIDE}.skn'/></deformable>")


@xml_case("a model to attach, which is read by rules of its own")
def attached_model() -> bytes:
    return with_files(
        "<asset><model name='m' file='parts/part.xml'/></asset>",
        **{"parts/part.xml": model(f"<asset><mesh name='m' file='{OUTSIDE}.stl'/></asset>")},
    )


@xml_case("a mesh by an address")
def mesh_by_address() -> bytes:
    return model("<asset><mesh name='m' file='http://127.0.0.1:1/m.stl'/></asset>")


@xml_case("a mesh above the upload, by backslashes")
def mesh_by_backslashes() -> bytes:
    return model("<asset><mesh name='m' file='..\\..\\outside.stl'/></asset>")


@xml_case("a mesh that was not uploaded")
def missing_mesh() -> bytes:
    return model("<asset><mesh name='m' file='missing.stl'/></asset>")


@xml_case("a picture that is to be read as a model (USD)")
def false_content_type() -> bytes:
    return with_files(
        "<asset><mesh name='m' file='m.stl' content_type='text/usd'/></asset>", **{"m.stl": stl(1)}
    )


@xml_case("a mesh in a format that nobody has looked at")
def unknown_mesh_format() -> bytes:
    return with_files("<asset><mesh name='m' file='m.ply'/></asset>", **{"m.ply": b"ply"})


@xml_case("a device file as a mesh")
def mesh_is_device() -> bytes:
    return model("<asset><mesh name='m' file='/dev/zero' content_type='model/stl'/></asset>")


@xml_case("run code by a plugin")
def plugin() -> bytes:
    return model("<extension><plugin plugin='mujoco.sdf.nut'/></extension>")


@xml_case("run code by a plugin of a body")
def body_plugin() -> bytes:
    return model(world="<body><plugin plugin='mujoco.elasticity.cable'/><geom size='1'/></body>")


@xml_case("a grid of a billion bodies")
def flexcomp_bomb() -> bytes:
    return model(world="<flexcomp name='f' type='grid' count='1000 1000 1000' spacing='1 1 1'/>")


@xml_case("a rope of a billion bodies")
def composite_bomb() -> bytes:
    return model(world="<composite type='cable' count='1000000000 1 1' curve='s'/>")


@xml_case("a body repeated a billion times")
def replicate_bomb() -> bytes:
    return model(world="<replicate count='1000000000'><body><geom size='1'/></body></replicate>")


@xml_case("a body repeated a hundred times, five times over")
def nested_replicates() -> bytes:
    return model(
        world="<replicate count='100'>" * 5 + "<body><geom size='1'/></body>" + "</replicate>" * 5
    )


@xml_case("sensors of a site that is repeated: MuJoCo repeats them as well")
def replicated_names() -> bytes:
    return model(
        "<sensor>" + "<framepos objtype='site' objname='s'/>" * 10_000 + "</sensor>",
        world="<replicate count='10000'><site name='s'/></replicate>",
    )


@xml_case("an include that is repeated, with what it includes")
def replicated_include() -> bytes:
    part = "<mujocoinclude><body><geom size='1'/></body></mujocoinclude>"
    return zipped(
        **{
            "model.xml": model(
                world="<replicate count='90000'><include file='parts/a.xml'/></replicate>"
            ),
            "parts/a.xml": part,
        }
    )


@xml_case("a picture of 10^12 pixels")
def texture_bomb() -> bytes:
    return model(
        "<asset><texture name='t' type='2d' builtin='flat' width='1000000' height='1000000'/>"
        "</asset>"
    )


@xml_case("a thousand pictures of the largest size, by their default class")
def texture_by_default() -> bytes:
    return model(
        "<default><texture width='8192' height='8192'/></default><asset>"
        + "".join(f"<texture name='t{n}' builtin='flat'/>" for n in range(1000))
        + "</asset>"
    )


@xml_case("a height field of 10^12 heights")
def hfield_bomb() -> bytes:
    return model("<asset><hfield name='h' nrow='1000000' ncol='1000000' size='1 1 1 1'/></asset>")


@xml_case("an arena of 100 GB")
def arena() -> bytes:
    return model("<size memory='100G'/>")


@xml_case("two billion constraints")
def constraints() -> bytes:
    return model("<size njmax='2000000000'/>")


@xml_case("two billion numbers of the user")
def user_data() -> bytes:
    return model("<size nuserdata='2000000000'/>")


@xml_case("a thousand numbers of the user at each of 50 000 sites")
def user_numbers() -> bytes:
    return model("<size nuser_site='10000'/>", world="<site/>" * 50_000)


@xml_case("a history of a billion samples")
def sensor_history() -> bytes:
    return model("<sensor><clock nsample='1000000000' delay='1' interval='1'/></sensor>")


@xml_case("a thousand million keyframes")
def keyframes() -> bytes:
    return model("<size nkey='1000000000'/>")


@xml_case("a custom number of a billion numbers")
def custom_number() -> bytes:
    return model("<custom><numeric name='n' size='1000000000'/></custom>")


@xml_case("a mesh made of a billion triangles by a builtin shape")
def builtin_mesh() -> bytes:
    return model("<asset><mesh name='m' builtin='supertorus' params='100000 1 1 1'/></asset>")


@xml_case("a simulation of years while compiling")
def length_range() -> bytes:
    return model("<compiler><lengthrange inttotal='1e15' timestep='1e-6'/></compiler>")


@xml_case("a solver that never ends")
def solver_iterations() -> bytes:
    return model("<option iterations='2000000000' ccd_iterations='2000000000'/>")


@xml_case("bodies nested five thousand deep")
def deep_bodies() -> bytes:
    n = 5000
    return model(world="<body><geom size='1'/>" * n + "</body>" * n)


@xml_case("a mass that is no number")
def nan_mass() -> bytes:
    return model(world="<body><freejoint/><geom size='1' mass='nan'/></body>")


@xml_case("an infinite place")
def infinite_place() -> bytes:
    return model(world="<body pos='0 0 inf'><geom size='1'/></body>")


@xml_case("a number too large for its square, in hexadecimal")
def huge_number() -> bytes:
    return model(world="<body pos='0 0 0x1p1000'><geom size='1'/></body>")


@xml_case("a custom number that is none")
def nan_annotation() -> bytes:
    return model("<custom><numeric name='front' data='nan 0 0'/></custom>")


@case("model", "robot.urdf", "another format with rules of its own (URDF)")
def urdf() -> bytes:
    return (
        f"<robot name='r'><link name='l'><visual><geometry><mesh filename='{OUTSIDE}.stl'/>"
        "</geometry></visual></link></robot>"
    ).encode()


@case("model", "model.xml", "URDF that calls itself MJCF")
def urdf_as_xml() -> bytes:
    return urdf()


@case("model", "model.usda", "another format with rules of its own (USD)")
def usd() -> bytes:
    return f"#usda 1.0\n( subLayers = [@{OUTSIDE}@] )\n".encode()


@case("model", "model.mjb", "a compiled model, which MuJoCo believes")
def mjb() -> bytes:
    return struct.pack("<i", 54321) + b"\xff" * 4096


@case("model", "model.xml", "nothing")
def empty_model() -> bytes:
    return b""


@case("model", "model.xml.gz", "packed otherwise")
def gzipped() -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    return packer.compress(model()) + packer.flush()


# ---- meshes and pictures -------------------------------------------------------------------------


def stl(faces: int, claimed: int | None = None) -> bytes:
    return bytes(80) + struct.pack("<I", faces if claimed is None else claimed) + bytes(50 * faces)


def png(width: int, height: int, data: bytes = b"") -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        return (
            struct.pack(">I", len(content)) + kind + content
            + struct.pack(">I", zlib.crc32(kind + content))
        )  # fmt: skip

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data or zlib.compress(b"\0"))
        + chunk(b"IEND", b"")
    )  # fmt: skip


def mesh_zip(name: str, content: bytes) -> bytes:
    return with_files(f"<asset><mesh name='m' file='{name}'/></asset>", **{name: content})


def texture_zip(content: bytes) -> bytes:
    return with_files(
        "<asset><texture name='t' type='2d' file='t.png'/></asset>", **{"t.png": content}
    )


@zip_case("an STL that claims four thousand million triangles")
def stl_claim() -> bytes:
    return mesh_zip("m.stl", stl(1, 0xFFFFFFFF))


@zip_case("an OBJ whose faces point far outside its vertices")
def obj_index() -> bytes:
    return mesh_zip("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2000000000\n")


@zip_case("an OBJ whose faces point before its vertices")
def obj_negative() -> bytes:
    return mesh_zip("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -2000000000\n")


@zip_case("an OBJ of one line of megabytes")
def obj_line() -> bytes:
    return raw_zip(
        Raw(content=model("<asset><mesh name='m' file='m.obj'/></asset>")),
        Raw(name=b"m.obj", content=b"v 0 0 0\nf" + b" 1" * (4 * MIB)),
    )


@zip_case("a MuJoCo mesh whose header claims two thousand million vertices")
def msh_claim() -> bytes:
    return mesh_zip("m.msh", struct.pack("<4i", 2**31 - 1, 0, 0, 1))


@zip_case("a MuJoCo mesh with negative counts")
def msh_negative() -> bytes:
    return mesh_zip("m.msh", struct.pack("<4i", -1, -1, -1, -1) + bytes(100))


@zip_case("a picture of 100 000 x 100 000 pixels in a hundred bytes")
def png_claim() -> bytes:
    return texture_zip(png(100_000, 100_000))


@zip_case("a picture of one pixel that unpacks to a gigabyte")
def png_bomb() -> bytes:
    data = b"\x78\xda" + zeros(1024) + bytes(4)
    return raw_zip(
        Raw(content=model("<asset><texture name='t' type='2d' file='t.png'/></asset>")),
        Raw(name=b"t.png", content=png(1, 1, data)),
    )


@zip_case("a picture with a part that claims to be longer than the file")
def png_chunk() -> bytes:
    content = png(1, 1)
    return texture_zip(content[:33] + b"\xff\xff\xff\xff" + content[37:])


@zip_case("a height field whose header claims 2^60 heights")
def hfield_claim() -> bytes:
    return with_files(
        "<asset><hfield name='h' size='1 1 1 1' file='h.bin'/></asset>",
        **{"h.bin": struct.pack("<2i", 2**30, 2**30)},
    )


@zip_case("a skin whose header claims two thousand million bones")
def skin_claim() -> bytes:
    return with_files(
        "<deformable><skin name='s' file='s.skn'/></deformable>",
        **{"s.skn": struct.pack("<4i", 3, 0, 1, 2**31 - 1) + bytes(200)},
    )


# ---- clips ---------------------------------------------------------------------------------------


class Runs:
    """Pickles to a call that would leave a file behind."""

    def __reduce__(self) -> tuple[Any, ...]:
        import os

        return os.system, (f"echo {CANARY} > {OUTSIDE}.ran",)


def npz(**members: bytes) -> bytes:
    return zipped(**{f"{name}.npy": content for name, content in members.items()})


def npy(array: Any, **how: Any) -> bytes:
    content = io.BytesIO()
    np.lib.format.write_array(content, np.asarray(array), **how)
    return content.getvalue()


def npy_header(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def clip_case(filename: str, tries: str) -> Any:
    return case("clip", filename, tries)


TIME = npy(np.arange(3) / 30)
STILL = np.tile(np.eye(14)[3], (3, 1))  # of a character with 14 coordinates, its quaternion one


@clip_case("clip.npz", "run code by a pickled array")
def npz_pickle() -> bytes:
    return npz(
        qpos=npy(np.array([Runs()], dtype=object), allow_pickle=True), fps=npy(30.0), time=TIME
    )


@clip_case("clip.npz", "claim an array of 2^60 bytes")
def npz_claim() -> bytes:
    head = npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000, 100000000)}")
    return npz(qpos=head, fps=npy(30.0))


@clip_case("clip.npz", "claim a negative shape")
def npz_negative() -> bytes:
    head = npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -7)}")
    return npz(qpos=head, fps=npy(30.0))


@clip_case("clip.npz", "unpack to eight gigabytes of zeros")
def npz_bomb() -> bytes:
    head = npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (143165576, 7)}")
    packed = zeros(8192, head)
    size = len(head) + 8192 * MIB
    return raw_zip(
        Raw(name=b"qpos.npy", packed=packed, size=min(size, 2**32 - 1), method=8, crc=0),
        Raw(name=b"fps.npy", content=npy(30.0)),
    )


@clip_case("clip.npz", "sixty thousand arrays")
def npz_members() -> bytes:
    return raw_zip(*(Raw(name=b"%d.npy" % n, content=b"") for n in range(60_000)))


@clip_case("clip.npz", "an array header with code in it")
def npz_header_code() -> bytes:
    return npz(qpos=npy_header("__import__('os').system('id')"), fps=npy(30.0))


@clip_case("clip.npz", "an array header nested until the stack ends")
def npz_header_deep() -> bytes:
    return npz(qpos=npy_header("(" * 30_000 + ")" * 30_000), fps=npy(30.0))


@clip_case("clip.npz", "text in it that is nested until the stack ends")
def npz_meta_deep() -> bytes:
    deep = "[" * 100_000 + "]" * 100_000
    return npz(
        qpos=npy(STILL), time=TIME, joint_names=npy(np.array(["a"])),
        meta=npy(np.array(deep)),
    )  # fmt: skip


@clip_case("clip.npz", "values that are no numbers")
def npz_nan() -> bytes:
    return npz(qpos=npy(np.full((3, 14), np.nan)), fps=npy(30.0))


@clip_case("clip.npz", "a rate of nothing")
def npz_rate() -> bytes:
    return npz(qpos=npy(STILL), fps=npy(float("nan")))


@clip_case("clip.npz", "time that runs backwards")
def npz_time() -> bytes:
    return npz(qpos=npy(STILL), time=npy(np.array([0.0, -1.0, 1e308])))


@clip_case("clip.npy", "run code by a pickled array")
def npy_pickle() -> bytes:
    return npy(np.array([[Runs()]], dtype=object), allow_pickle=True)


@clip_case("clip.npy", "claim an array of 2^60 bytes")
def npy_claim() -> bytes:
    return npy_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1152921504606846976, 7)}")


@clip_case("clip.pkl", "run code by reduce")
def pickle_reduce() -> bytes:
    return pickle.dumps({"root_pos": Runs(), "fps": 30})


@clip_case("clip.pkl", "run code by the oldest opcodes")
def pickle_old() -> bytes:
    return f"cos\nsystem\n(S'echo {CANARY} > {OUTSIDE}.ran'\ntR.".encode()


@clip_case("clip.pkl", "run code by an instance opcode")
def pickle_instance() -> bytes:
    return b"(S'id'\nios\nsystem\n."


@clip_case("clip.pkl", "reach code through a name with dots")
def pickle_dotted() -> bytes:
    return b"\x80\x04\x8c\x05numpy\x8c\x10ndarray.__init__\x93."


@clip_case("clip.pkl", "evaluate text by a permitted module")
def pickle_eval() -> bytes:
    return b"\x80\x04\x8c\x08builtins\x8c\x04eval\x93\x8c\x0217\x85R."


@clip_case("clip.pkl", "a memo slot far away, for which a table is allocated")
def pickle_memo() -> bytes:
    return b"\x80\x04]r\xff\xff\xff\x7f."


@clip_case("clip.pkl", "a whole number of two gigabytes")
def pickle_long() -> bytes:
    return b"\x80\x04\x8b\xff\xff\xff\x7f."


@clip_case("clip.pkl", "a decimal number of megabytes, which takes for ever to read")
def pickle_decimal() -> bytes:
    return b"L" + b"9" * (8 * MIB) + b"L\n."


@clip_case("clip.pkl", "lists nested a million deep")
def pickle_deep() -> bytes:
    return b"\x80\x04" + b"]" * 1_000_000 + b"a" * 999_999 + b"."


@clip_case("clip.pkl", "a list of lists of lists that is 2^60 long when walked")
def pickle_laughs() -> bytes:
    out = b"\x80\x04}\x8c\x08root_posK\x01"
    for n in range(60):
        out += b"q%c0](h%ch%ce" % (n, n, n)
    for name in (b"root_rot", b"dof_pos", b"fps"):
        out += b"s\x8c%c%bK\x01" % (len(name), name)
    return out + b"s."


@clip_case("clip.pkl", "an object by its persistent name")
def pickle_persistent() -> bytes:
    return b"Pevil\n."


@clip_case("clip.pkl", "a frame that claims 2^60 bytes")
def pickle_frame() -> bytes:
    return b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x0f."


@clip_case("clip.pkl", "text that claims four gigabytes")
def pickle_text() -> bytes:
    return b"\x80\x04X\xff\xff\xff\xff."


@clip_case("clip.pkl", "an array that starts from a claimed shape")
def pickle_array() -> bytes:
    return (
        b"\x80\x04\x8c\x16numpy._core.multiarray\x8c\x0c_reconstruct\x93\x8c\x05numpy\x8c\x07ndarray"
        b"\x93J\xff\xff\xff\x7f\x85C\x01b\x87R."
    )


@clip_case("clip.csv", "one line of a hundred megabytes")
def csv_line() -> bytes:
    return b"0," * (50 * MIB) + b"0\n"


@clip_case("clip.csv", "infinite values")
def csv_infinite() -> bytes:
    return b"inf,nan,0,1,0,0,0\n" * 10


@clip_case("clip.csv", "a value of a million digits")
def csv_digits() -> bytes:
    return b"9" * MIB + b",0,0,1,0,0,0\n"


@clip_case("clip.csv", "bytes that are no text")
def csv_bytes() -> bytes:
    return bytes(range(256)) * 100


# ---- captures ------------------------------------------------------------------------------------


def capture_case(filename: str, tries: str) -> Any:
    return case("capture", filename, tries)


BVH = (
    "HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition "
    "Zrotation Xrotation Yrotation\n{inside}\nEnd Site\n{{\nOFFSET 0 1 0\n}}\n}}\n"
    "MOTION\nFrames: {frames}\nFrame Time: {step}\n{rows}"
)


@capture_case("walk.bvh", "claim a thousand million frames")
def bvh_frames() -> bytes:
    return BVH.format(inside="", frames=10**9, step=0.01, rows="0 0 0 0 0 0\n").encode()


@capture_case("walk.bvh", "claim more frames than a number holds")
def bvh_digits() -> bytes:
    return BVH.format(inside="", frames="9" * 10_000, step=0.01, rows="0 0 0 0 0 0\n").encode()


@capture_case("walk.bvh", "a frame time of nothing")
def bvh_time() -> bytes:
    return BVH.format(inside="", frames=1, step="nan", rows="0 0 0 0 0 0\n").encode()


@capture_case("walk.bvh", "joints nested a hundred thousand deep")
def bvh_deep() -> bytes:
    n = 100_000
    joint = "JOINT j\n{\nOFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    return BVH.format(inside=joint * n + "}\n" * n, frames=1, step=0.01, rows="0\n").encode()


@capture_case("walk.bvh", "claim a thousand million channels")
def bvh_channels() -> bytes:
    return b"HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1000000000 Xposition\n}\nMOTION\n"


@capture_case("walk.c3d", "claim markers and frames that are not there")
def c3d_claim() -> bytes:
    head = bytearray(512)
    head[0:2] = b"\x02\x50"
    struct.pack_into("<9H", head, 2, 0xFFFF, 0xFFFF, 1, 0xFFFF, 0, 0xFFFF, 0xFFFF, 0xFFFF, 0)
    return bytes(head) + b"\x01\x50\xff\x54" + bytes(1024)


@capture_case("walk.c3d", "parameters that point outside the file")
def c3d_parameters() -> bytes:
    return b"\xff\x50" + b"\xff" * 2048


@capture_case("walk.trc", "claim a thousand million frames and markers")
def trc_claim() -> bytes:
    return (
        b"PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
        b"100\t100\t1000000000\t1000000000\tmm\nFrame#\tTime\ta\n\t\tX1\tY1\tZ1\n1\t0\t0\t0\t0\n"
    )


@capture_case("walk.amc", "a capture without the skeleton that it needs")
def amc_alone() -> bytes:
    return b":FULLY-SPECIFIED\n:DEGREES\n" + b"1\nroot 0 0 0 0 0 0\n" * 100


@capture_case("walk.txt", "JSON nested until the stack ends")
def deepmimic_deep() -> bytes:
    return b'{"Loop":"wrap","Frames":' + b"[" * 200_000 + b"]" * 200_000 + b"}"


@capture_case("walk.txt", "frames that are no numbers")
def deepmimic_values() -> bytes:
    return json.dumps({"Loop": "wrap", "Frames": [[float("nan")] * 44] * 3}).encode()


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    for each in CASES:
        place = folder / each.kind / each.name / each.filename
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(each.content())
    print(f"{len(CASES)} uploads in {folder}")
