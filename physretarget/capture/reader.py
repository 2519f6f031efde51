"""The readers of captures: each format once, known by its content first, then by its name's ending.

To add a format, write a module whose function takes a path and :class:`ReadOptions` and gives a
recording, and add a line to :data:`READERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import cast

from physretarget.capture.recording import JointRecording, MarkerRecording, Names
from physretarget.errors import InputError, UsageError

__all__ = ["READERS", "ReadOptions", "Reader", "find_reader"]

_HEAD = 2048


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a file may not say of itself; None where the user said nothing.

    Attributes:
        unit: m, cm, mm, inch, cmu, or metres per unit as a number.
        up: x, y, z, -x, -y or -z.
        skeleton: the ASF file of an AMC motion.
        subject: whom to take of several people: a name, or a number from 1.
        rate: frames per second of a file that does not say.
        names: which joint or marker is which part, where the user says so.
    """

    unit: str | None = None
    up: str | None = None
    skeleton: str | Path | None = None
    subject: str | None = None
    rate: float | None = None
    names: Names | None = None


Read = Callable[[str | Path, ReadOptions], JointRecording | MarkerRecording]


@dataclass(frozen=True, kw_only=True)
class Reader:
    """One format.

    Attributes:
        name: as in the notes of what is read.
        title: what it is, for people.
        endings: of file names, with the dot.
        module: of this package, whose ``read`` reads it; imported when asked for.
        begins: whether the head of a file (bytes, without a mark or blanks) is of this format.
        people: whether a file may hold several.
        extra: what ``pip install 'physretarget[extra]'`` must have brought.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    module: str
    begins: Callable[[bytes], bool] = lambda head: False
    people: bool = False
    extra: str | None = None

    def read(self, path: str | Path, options: ReadOptions) -> JointRecording | MarkerRecording:
        """Read a file of this format.

        Raises:
            UsageError: an option is given that this format has no use for.
            InputError: the file cannot be used.
            MissingExtraError: a library is missing.
        """
        if options.subject is not None and not self.people:
            raise UsageError(f"{self.title}: files hold one person; leave the subject out.")
        if options.skeleton is not None and self.name != "amc":
            raise UsageError("A skeleton is for AMC motions alone; other captures bring their own.")
        function = import_module(f"physretarget.capture.{self.module}").read
        return cast(Read, function)(path, options)


def _starts(*words: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.lower().startswith(words)


READERS = (
    Reader(name="bvh", title="BVH skeleton and motion", endings=(".bvh",), module="bvh",
           begins=_starts(b"hierarchy"), people=True),
    Reader(name="c3d", title="optical markers, C3D", endings=(".c3d",), module="c3d",
           begins=lambda head: len(head) > 1 and head[1] == 0x50 and head[0] < 32, people=True),
    Reader(name="trc", title="optical markers as text, TRC", endings=(".trc",), module="trc",
           begins=_starts(b"pathfiletype"), people=True),
    Reader(name="amc", title="Acclaim motion with its .asf skeleton", endings=(".amc",),
           module="amc"),
    Reader(name="smpl", title="SMPL, SMPL-H, SMPL-X parameters (AMASS, AIST++, OMOMO)",
           endings=(".npz", ".pkl"), module="smpl"),
    Reader(name="mvnx", title="Xsens MVNX", endings=(".mvnx",), module="mvnx",
           begins=lambda head: head.startswith(b"<") and b"<mvnx" in head),
    Reader(name="gltf", title="glTF skeleton animation, VRM animation",
           endings=(".glb", ".gltf", ".vrma"), module="gltf_motion", begins=_starts(b"gltf")),
    Reader(name="usd", title="USD skeleton animation", endings=(".usd", ".usda", ".usdc", ".usdz"),
           module="usd_motion", begins=_starts(b"pxr-usdc", b"#usda"), extra="usd"),
    Reader(name="fbx", title="FBX skeleton animation", endings=(".fbx",), module="fbx_motion",
           begins=_starts(b"kaydara fbx", b"; fbx"), extra="fbx"),
    Reader(name="motive", title="OptiTrack Motive's export", endings=(".csv",), module="motive",
           begins=_starts(b"format version")),
    Reader(name="qualisys", title="Qualisys' export", endings=(".tsv",), module="qualisys",
           begins=_starts(b"no_of_frames"), people=True),
    Reader(name="deepmimic", title="DeepMimic humanoid3d motion", endings=(".txt",),
           module="deepmimic", begins=lambda head: (head.startswith(b"{") and b'"Frames"' in head)
           or (head.startswith(b"{") and b'"Loop"' in head)),
    Reader(name="keypoints", title="3-D key points (MediaPipe, OpenPose, FreeMoCap, H36M)",
           endings=(".json", ".csv", ".npy"), module="keypoints", people=True),
)  # fmt: skip
"""Every format, the surest of its kind first: of those that share an ending, the one that the
content names is taken, else the last."""


def find_reader(path: str | Path) -> Reader:
    """The reader of a file, by its content first, then by its name's ending.

    Args:
        path: The capture.

    Returns:
        The reader.

    Raises:
        InputError: there is no such file, it is empty, or of no known format.
    """
    path = Path(path)
    if not path.exists():
        raise InputError("The file does not exist.", path=path)
    if not path.is_file():
        raise InputError("This is a folder or a device, not a file.", path=path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head:
        raise InputError("The file is empty.", path=path)
    if head.startswith(b"version https://git-lfs"):
        raise InputError(
            "This is a git-lfs pointer, not the capture: fetch the file itself (git lfs pull).",
            path=path,
        )
    ending = path.suffix.lower()
    if ending == ".asf":
        raise InputError("An ASF file is a skeleton alone: give the AMC motion.", path=path)
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    for reader in READERS:
        if reader.begins(text if reader.name != "c3d" or ending != ".c3d" else head):
            return reader
    named = [reader for reader in READERS if ending in reader.endings]
    if named:
        return named[-1]
    known = "; ".join(f"{', '.join(r.endings)} ({r.title})" for r in READERS)
    raise InputError(
        f"Unknown capture format {ending or 'without ending'!r}: known are {known}.", path=path
    )
