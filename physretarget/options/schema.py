"""Which options each command has, and so the service's jobs, the suite's cases, the web form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any

from physretarget.errors import UsageError
from physretarget.options.declaration import Option, options_of
from physretarget.options.facial import (
    CurvesFile,
    EventOptions,
    LibraryFiles,
    LibraryOptions,
    MatchOptions,
    MatchReport,
    RangeOptions,
    ReductionOptions,
    RigFile,
)
from physretarget.options.forces import ForcesOptions, ForcesOutput
from physretarget.options.judging import (
    ConfigFile,
    JudgingOptions,
    ReportOptions,
    ValidationOptions,
)
from physretarget.options.motion import (
    CaptureOptions,
    CharacterFile,
    ClipModel,
    ClipOptions,
    ConversionOptions,
    FixOutput,
    InspectionOutput,
    NameMapFile,
    ReplayOptions,
    Resampling,
    SkeletonFile,
)
from physretarget.options.posing import (
    NewCharacterOptions,
    PlantOptions,
    ProposeOptions,
    SheetFile,
    StudioOptions,
    SuggestOptions,
)
from physretarget.options.retargeting import (
    KeyPoseFiles,
    MapperFile,
    MapperOptions,
    MapperSource,
    PhasesFile,
    PresetOption,
    RetargetOutput,
    RetargetSettings,
    StreamOptions,
    StreamSource,
)
from physretarget.options.simulation import SimulationOptions, SimulationOutput


@dataclass(frozen=True, kw_only=True)
class Schema:
    """The options of one command, as settings classes.

    Attributes:
        name: the command's.
        files: what it reads besides the clips or captures: command line and suite file; the
            service takes them as uploads.
        shared: what changes its result: command line, suite file, API and web form.
        here: what concerns the command line alone.
    """

    name: str
    files: tuple[type, ...] = ()
    shared: tuple[type, ...] = ()
    here: tuple[type, ...] = ()

    @cached_property
    def command_line(self) -> tuple[Option, ...]:
        """All options, in the order of the help."""
        return _options((*self.files, *self.shared, *self.here))

    @cached_property
    def api(self) -> tuple[Option, ...]:
        """Those of the service's jobs and of the web form, where no path means anything."""
        return tuple(replace(each, or_file="") for each in _options(self.shared))

    @cached_property
    def suite(self) -> tuple[Option, ...]:
        """Those of the suite file."""
        return _options((*self.files, *self.shared))

    def of_job(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Of all options given those that change the result."""
        names = {each.name for each in self.suite}
        return {name: value for name, value in given.items() if name in names}


def _options(groups: tuple[type, ...]) -> tuple[Option, ...]:
    return tuple({each.name: each for group in groups for each in options_of(group)}.values())


def find(name: str, options: tuple[Option, ...]) -> Option:
    """The option of a name or an alias.

    Raises:
        UsageError: there is none; says which there are.
    """
    for each in options:
        if name in each.names:
            return each
    names = [each.name for each in options]
    close = get_close_matches(name, names, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    raise UsageError(f"there is no option {name!r}: {hint}there are {', '.join(names)}.")


def read(given: Mapping[str, Any], options: tuple[Option, ...]) -> dict[str, Any]:
    """Options from a file or a program, checked, by name; those that are null are left out.

    Raises:
        UsageError: one sentence about the first that is unknown or holds what is not allowed.
    """
    values: dict[str, Any] = {}
    for name, value in given.items():
        each = find(name, options)
        if value is not None:
            values[each.name] = each.read(value, name)
    return values


VALIDATE = Schema(
    name="validate",
    files=(ClipModel, ConfigFile),
    shared=(ValidationOptions, ClipOptions),
    here=(ReportOptions,),
)
LEARN = Schema(
    name="learn", files=(CharacterFile, KeyPoseFiles), shared=(MapperOptions,), here=(MapperFile,)
)
RETARGET = Schema(
    name="retarget",
    files=(CharacterFile, KeyPoseFiles, SkeletonFile, NameMapFile, PhasesFile, ConfigFile),
    shared=(
        PresetOption,
        MapperSource,
        RetargetSettings,
        SimulationOptions,
        CaptureOptions,
        JudgingOptions,
    ),
    here=(RetargetOutput,),
)
FORCES = Schema(
    name="forces",
    files=(SkeletonFile, NameMapFile),
    shared=(CaptureOptions, ForcesOptions),
    here=(ForcesOutput,),
)
INSPECT = Schema(
    name="inspect",
    files=(SkeletonFile, NameMapFile),
    shared=(CaptureOptions,),
    here=(InspectionOutput,),
)
STREAM = Schema(
    name="stream", files=(NameMapFile,), shared=(StreamOptions, Resampling), here=(StreamSource,)
)
FIX = Schema(
    name="fix",
    files=(ClipModel, ConfigFile),
    shared=(ValidationOptions, ClipOptions),
    here=(FixOutput,),
)
SIMULATE = Schema(
    name="simulate",
    files=(ClipModel,),
    shared=(SimulationOptions, ClipOptions),
    here=(SimulationOutput,),
)
CONVERT = Schema(name="convert", shared=(ClipOptions,), here=(ConversionOptions,))
REPLAY = Schema(name="replay", files=(ClipModel,), shared=(ClipOptions,), here=(ReplayOptions,))
LIBRARY = Schema(name="face library", files=(RigFile,), here=(LibraryOptions,))
MATCH = Schema(
    name="face match",
    files=(LibraryFiles, RigFile),
    shared=(MatchOptions, RangeOptions, Resampling),
    here=(CurvesFile, MatchReport),
)
REDUCE = Schema(
    name="face reduce",
    files=(RigFile,),
    shared=(ReductionOptions, Resampling),
    here=(CurvesFile,),
)
EVENTS = Schema(name="face events", files=(RigFile,), here=(EventOptions,))
CHECK = Schema(name="keyposes check", files=(CharacterFile,))
SHEET = Schema(name="keyposes sheet", files=(CharacterFile,), here=(SheetFile,))
SUGGEST = Schema(
    name="keyposes suggest", files=(CharacterFile, NameMapFile), here=(SuggestOptions,)
)
PROPOSE = Schema(
    name="keyposes propose", files=(CharacterFile, NameMapFile), here=(ProposeOptions,)
)
PLANT = Schema(name="keyposes plant", files=(CharacterFile,), here=(PlantOptions,))
CHARACTER_NEW = Schema(name="character new", here=(NewCharacterOptions,))
STUDIO = Schema(name="studio", files=(CharacterFile, NameMapFile), here=(StudioOptions,))

JOBS = {each.name: each for each in (VALIDATE, RETARGET)}
"""What the service and the suite do, by the name of the kind."""
SCHEMAS = (
    VALIDATE, LEARN, RETARGET, FORCES, INSPECT, STREAM, CONVERT, REPLAY, LIBRARY, MATCH, REDUCE,
    EVENTS,
    CHECK, SHEET, SUGGEST, PROPOSE, PLANT, CHARACTER_NEW, STUDIO, SIMULATE,
)  # fmt: skip
