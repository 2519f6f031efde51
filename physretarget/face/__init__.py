"""From dense facial capture to an animator's curves (Ruhland, Prasad, McDonnell 2017)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physretarget._lazy import attribute_getter

if TYPE_CHECKING:
    from physretarget.face.curve import Curve, Key
    from physretarget.face.distance import distance_profile
    from physretarget.face.formats import read_shots, read_take, write_shot
    from physretarget.face.library import Library, LibrarySettings
    from physretarget.face.match import MatchSettings, Result
    from physretarget.face.match import match as match_take
    from physretarget.face.reduce import reduce_curve
    from physretarget.face.rig import Rig
    from physretarget.face.shot import Shot, Take

# Public name → (module, name there).
_WHERE = {
    "Curve": ("curve", "Curve"),
    "Key": ("curve", "Key"),
    "Library": ("library", "Library"),
    "LibrarySettings": ("library", "LibrarySettings"),
    "MatchSettings": ("match", "MatchSettings"),
    "Result": ("match", "Result"),
    "Rig": ("rig", "Rig"),
    "Shot": ("shot", "Shot"),
    "Take": ("shot", "Take"),
    "distance_profile": ("distance", "distance_profile"),
    "match_take": ("match", "match"),
    "read_shots": ("formats", "read_shots"),
    "read_take": ("formats", "read_take"),
    "reduce_curve": ("reduce", "reduce_curve"),
    "write_shot": ("formats", "write_shot"),
}

__all__ = [
    "Curve",
    "Key",
    "Library",
    "LibrarySettings",
    "MatchSettings",
    "Result",
    "Rig",
    "Shot",
    "Take",
    "distance_profile",
    "match_take",
    "read_shots",
    "read_take",
    "reduce_curve",
    "write_shot",
]

__getattr__ = attribute_getter(__name__, _WHERE)
