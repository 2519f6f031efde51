"""Every option, declared once; command line, service, web form, suite file and Python follow.

An option is a field of a settings class::

    lowpass_hz: float | None = option(
        6.0, name="lowpass", help="Low-pass filter on the capture; 0 for none.",
        unit="Hz", above=0, most=1000, zero_for_none=True,
    )

Its annotation says the type: ``bool``, ``int``, ``float``, ``str``, ``Path``, a ``Literal`` of
words, or a ``tuple`` of these for several values.
:class:`~physretarget.options.declaration.Option` explains all else.

**To add an option** to a command, add such a field to one of its settings classes. Which these are
is said by its :class:`~physretarget.options.schema.Schema`: ``shared`` classes are offered on every
surface, ``files`` on the command line and in suite files, ``here`` on the command line alone. The
value then arrives in the settings object; nothing else is written by hand.

**To add a command**, give it a ``Schema``, write its function in a module of
:mod:`physretarget.cli` and add a line to ``COMMANDS`` there::

    SMOOTH = Schema(name="smooth", files=(ClipModel,), shared=(ClipOptions, SmoothingOptions))

    @command(app, "smooth", SMOOTH, example="physretarget smooth jump.npz --model lamp.xml")
    def smooth_command(clip: ClipArgument, given: Given) -> None:
        settings = build(SmoothingOptions, given)

``given`` holds the options that were typed, by name, checked. ``build`` makes a settings object of
them; what was not typed has its default. The same mapping is what a suite's case and the service's
job carry.
"""

from __future__ import annotations

from physretarget.options.declaration import Option, build, check, option, options_of, told
from physretarget.options.retargeting import with_preset
from physretarget.options.schema import (
    CHARACTER_NEW,
    CHECK,
    CONVERT,
    EVENTS,
    FIX,
    FORCES,
    INSPECT,
    JOBS,
    LEARN,
    LIBRARY,
    MATCH,
    PLANT,
    PROPOSE,
    REDUCE,
    REPLAY,
    RETARGET,
    SCHEMAS,
    SHEET,
    SIMULATE,
    STREAM,
    STUDIO,
    SUGGEST,
    VALIDATE,
    Schema,
    find,
    read,
)

__all__ = [
    "CHARACTER_NEW",
    "CHECK",
    "CONVERT",
    "EVENTS",
    "FIX",
    "FORCES",
    "INSPECT",
    "JOBS",
    "LEARN",
    "LIBRARY",
    "MATCH",
    "PLANT",
    "PROPOSE",
    "REDUCE",
    "REPLAY",
    "RETARGET",
    "SCHEMAS",
    "SHEET",
    "SIMULATE",
    "STREAM",
    "STUDIO",
    "SUGGEST",
    "VALIDATE",
    "Option",
    "Schema",
    "build",
    "check",
    "find",
    "option",
    "options_of",
    "read",
    "told",
    "with_preset",
]
