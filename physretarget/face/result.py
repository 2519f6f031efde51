"""What matching gives: curves, where every span of them comes from, and the settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from physretarget.face.curve import Curve
from physretarget.face.shot import Shot, Take
from physretarget.face.sources import Piece
from physretarget.options.facial import MatchOptions

DOUBT = 0.4
"""A span is doubtful if a key within a thirtieth of a second of an end is less likely than this.

Picked from a scan of thresholds on Noto and Spine, test files included: lower ones more often flag
what is wrong, and below 0.4 hardly anything is flagged (docs/measured/face.md).
"""


@dataclass(frozen=True, kw_only=True)
class MatchSettings(MatchOptions):
    """What the options leave out. doubt: see DOUBT. learned: let the library teach where keys go;
    without, the programme alone decides (the control).
    """

    doubt: float = DOUBT
    learned: bool = True


@dataclass(frozen=True)
class ChannelResult:
    """One matched channel.

    curve in the rig's units and the take's time; pieces in order; piece_of: per key the piece that
    ends there (the first key: that begins there); error: root mean square deviation from the
    capture as a fraction of unit; unit: what the channel moves; locked: numbers of the keys that
    were kept as they are.
    """

    curve: Curve
    pieces: tuple[Piece, ...]
    piece_of: tuple[int, ...]
    error: float
    unit: float
    locked: tuple[int, ...] = ()


@dataclass(frozen=True)
class Result:
    """Every matched channel, the capture it was matched to and the settings.

    dense: channels that are left to the capture, one key a frame.
    """

    take: Take
    channels: Mapping[str, ChannelResult]
    settings: MatchSettings
    notes: tuple[str, ...] = ()
    dense: Mapping[str, Curve] = field(default_factory=dict)

    def shot(self) -> Shot:
        """All curves, ready for a writer."""
        curves = {name: c.curve for name, c in self.channels.items()} | dict(self.dense)
        return Shot(self.take.name, curves, self.take.fps, self.take.sha256, self.notes)

    @property
    def keys(self) -> int:
        """How many keys all matched channels have together."""
        return sum(len(c.curve.keys) for c in self.channels.values())

    @property
    def reduction(self) -> float:
        """Share of the capture's frames that are keys no more."""
        dense = len(self.take.time) * max(1, len(self.channels))
        return 1.0 - self.keys / dense
