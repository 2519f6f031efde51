"""What the API takes and gives, as its description shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from physretarget.options.judging import Verdict

Id = Annotated[str, Field(pattern=r"^[0-9a-z]{26}$", examples=["01jd3m7x6v3k9q4t8w2z5y0abc"])]
Kind = Literal["validate", "retarget"]
Status = Literal["queued", "running", "done", "failed", "cancelled"]
Format = Literal["json", "html", "sarif", "junit", "markdown", "text"]
Moment = Annotated[str, Field(description="ISO 8601, UTC.", examples=["2030-01-02T03:04:05.678Z"])]


class _Out(BaseModel):
    model_config = ConfigDict(extra="forbid")


class JobClip(_Out):
    """The clip or capture of a job."""

    name: str
    sha256: str


class JobModel(_Out):
    """The model of a job; without an id where it was uploaded for this job only."""

    id: str | None
    name: str


class Summary(_Out):
    """The report in a line: numbers, verdict, why it was not judged, its probable cause."""

    errors: int
    warnings: int
    passed: bool
    verdict: Verdict = "passed"
    reason: str = ""
    cause: str = ""


class JobError(_Out):
    """Why a job failed: input, timeout, memory, crash or internal."""

    code: str
    message: str


class Links(_Out):
    """Where to go on."""

    self: str
    events: str
    cancel: str
    report: str
    replay: str
    clip: str


class Job(_Out):
    """A clip being judged, or a capture being retargeted and judged."""

    id: str
    kind: Kind
    status: Status
    progress: float = Field(ge=0, le=1)
    stage: str
    created: Moment
    started: Moment | None
    finished: Moment | None
    clip: JobClip
    model: JobModel
    options: dict[str, Any]
    summary: Summary | None
    error: JobError | None
    attempts: int
    links: Links


class JobPage(_Out):
    """A page of jobs, newest first."""

    items: list[Job]
    next: str | None = Field(description="Cursor of the next page; null on the last.")


class Clip(_Out):
    """An uploaded clip or capture."""

    id: str
    name: str
    sha256: str
    bytes: int
    created: Moment


class ClipPage(_Out):
    """A page of clips, newest first."""

    items: list[Clip]
    next: str | None


class ModelFinding(_Out):
    """A finding about the model itself."""

    code: str
    severity: Literal["error", "warning"]
    message: str
    body: str | None


class Model(_Out):
    """A character that clips can be judged with."""

    id: str
    name: str
    sha256: str
    mass_kg: float
    bodies: int
    joints: int
    findings: list[ModelFinding]
    builtin: bool
    created: Moment | None


class ModelPage(_Out):
    """A page of models: the built-in ones first, then newest first."""

    items: list[Model]
    next: str | None


class Side(_Out):
    """One of the two jobs of a comparison."""

    job: str
    name: str
    summary: Summary


class ComparedMeasure(_Out):
    """A measure on both sides; ``change`` is null where the difference says nothing."""

    name: str
    unit: str
    left: float | None
    right: float | None
    better: Literal["lower", "higher", "one", "none"]
    change: Literal["better", "worse"] | None


class ComparedFinding(_Out):
    """A kind of finding on both sides."""

    code: str
    left: int
    right: int
    change: Literal["new", "fixed", "both"]


class Compared(_Out):
    """The right job against the left one."""

    left: Side
    right: Side
    verdict: str
    reason: str
    measures: list[ComparedMeasure]
    findings: list[ComparedFinding]


class OptionShown(_Out):
    """An option of a job."""

    name: str
    kind: Literal["flag", "number", "whole", "text", "path", "table"]
    many: bool
    depth: int
    choices: list[str]
    or_metres: bool
    metavar: str
    least: float | None
    most: float | None
    above: float | None
    default: str
    help: str
    label: str
    advanced: bool


class QueueHealth(_Out):
    """How much there is to do."""

    queued: int
    running: int
    oldest: str | None = Field(default=None, description="When the oldest queued job was made.")


class Live(_Out):
    """The process answers."""

    status: Literal["ok"]
    version: str


class DiskHealth(_Out):
    """Free disk, and how much of it is kept."""

    free_bytes: int
    reserve_bytes: int


class TroubleShown(_Out):
    """Something that keeps work from being taken or done."""

    what: Literal["disk", "database", "workers"]
    message: str


class Health(_Out):
    """What the service is doing."""

    status: Literal["ok", "degraded"]
    version: str
    troubles: list[TroubleShown] = Field(description="Empty where all is well.")
    disk: DiskHealth
    database_age_s: float = Field(description="Since the last good look at the database.")
    queue: QueueHealth
    workers: int
    sandbox: dict[str, bool]
    tokens: bool = Field(description="A token is needed.")


class TicketRequest(BaseModel):
    """The path of a report, replay or clip that a frame or a link is to open."""

    model_config = ConfigDict(extra="forbid")
    path: Annotated[
        str,
        Field(
            max_length=500,
            pattern=r'^/api/v1/(jobs/[0-9a-z]{26}/(report|replay|clip)|compare/replay)(\?[!"$-~]*)?$',
            examples=["/api/v1/jobs/01jd3m7x6v3k9q4t8w2z5y0abc/report?format=html"],
        ),
    ]


class Ticket(_Out):
    """A URL that opens without a header, for a short time."""

    url: str
    expires_in: int
