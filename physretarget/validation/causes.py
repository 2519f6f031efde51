"""Which of several causes is the likeliest."""

from __future__ import annotations

from collections.abc import Sequence

from physretarget.validation.report import Cause

# Whoever reads a clip wrongly finds everything else in it too: these stand alone.
_GROSS = ("DAT006", "DAT007", "DAT011", "DAT010", "DAT013")
# What breaks the clip at one place, or all of it, before what shifts it.
_OTHERS = ("DAT015", "DAT012", "DAT003", "DAT008", "KIN003", "DAT014", "CON007", "CON006")


def likeliest(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """The causes, the likeliest first; of misreadings nothing but these."""
    if any(cause.code == "DAT012" for cause in causes):
        # Played too fast, whatever moves trembles.
        causes = [cause for cause in causes if cause.code != "KIN003"]
    gross = [cause for cause in causes if cause.code in _GROSS]
    order = _GROSS if gross else _OTHERS
    return tuple(sorted(gross or causes, key=lambda cause: order.index(cause.code)))
