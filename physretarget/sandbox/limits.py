"""Every bound on what a stranger may ask for, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from physretarget.errors import UsageError

MIB = 2**20
GIB = 2**30


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Bounds on uploads, on models, and on the process that works on them.

    Attributes:
        upload_bytes: one uploaded file.
        archive_bytes: all members of an archive, unpacked.
        archive_files: members of an archive, folders included.
        archive_ratio: unpacked bytes per packed byte, of one member and of all.
        name_bytes: one path inside an archive, UTF-8.
        name_depth: folders above a member.
        xml_bytes: all XML of a model, included files too.
        xml_elements: all elements of a model, after replication.
        xml_depth: nesting of elements.
        xml_attribute_bytes: one attribute's text, except numbers of keyframes and meshes.
        xml_includes: files included by a model.
        asset_bytes: all files a model names.
        asset_pixels: one picture.
        mesh_faces: all meshes of a model together; also vertices.
        model_bodies: bodies after replication.
        model_geoms: geoms after replication; each may touch each other.
        model_numbers: numbers that a model may make MuJoCo allocate (heights, user data, ...).
        seconds: wall clock of a job.
        cpu_seconds: processor time of a job.
        memory_bytes: address space of a job.
        file_bytes: one file that a job writes.
        folder_bytes: everything that a job writes.
        open_files: file descriptors of a job.
        processes: processes and threads of the user that the job runs as.
        request_bytes: the request sent to a job, as JSON.
        answer_bytes: the answer and all progress of a job, as JSON; and what it prints.
        clip_frames: frames of a clip.
    """

    upload_bytes: int = 256 * MIB
    archive_bytes: int = 512 * MIB
    archive_files: int = 2000
    archive_ratio: int = 200
    name_bytes: int = 240
    name_depth: int = 16
    xml_bytes: int = 8 * MIB
    xml_elements: int = 50_000
    xml_depth: int = 200
    xml_attribute_bytes: int = 4 * MIB
    xml_includes: int = 64
    asset_bytes: int = 256 * MIB
    asset_pixels: int = 8192 * 8192
    mesh_faces: int = 5_000_000
    model_bodies: int = 2_000
    model_geoms: int = 5_000
    model_numbers: int = 20_000_000
    seconds: float = 300.0
    cpu_seconds: int = 600
    memory_bytes: int = 2 * GIB
    file_bytes: int = 1 * GIB
    folder_bytes: int = 2 * GIB
    open_files: int = 256
    processes: int = 4096
    request_bytes: int = 1 * MIB
    answer_bytes: int = 16 * MIB
    clip_frames: int = 2_000_000

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not value > 0:
                raise UsageError(f"limit {name} is {value}, it must be above zero.")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as it goes to the child process."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Limits:
        """The inverse of :meth:`to_dict`; names that are none are refused."""
        known = {field.name for field in fields(cls)}
        unknown = sorted(set(values) - known)
        if unknown:
            raise UsageError(f"there is no limit {unknown[0]!r}; there are {sorted(known)}.")
        return cls(**values)
