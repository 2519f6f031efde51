"""ARKit's channel names in the spellings of recorders: ``eyeBlink_L``, ``EyeBlinkLeft``, …"""

from __future__ import annotations

_SIDES = {"_l": "Left", "_r": "Right"}


def full_name(name: str) -> str:
    """``eyeBlink_L`` as ARKit spells it: ``eyeBlinkLeft``.

    Args:
        name: Name of a channel.

    Returns:
        The name with its side in full; any other as it is.
    """
    return name[:-2] + _SIDES[name[-2:].lower()] if name[-2:].lower() in _SIDES else name


def plain_name(name: str) -> str:
    """What all spellings of a channel share: no node, no case, no underscores, sides in full.

    Args:
        name: Name of a channel, such as ``Face.blendShape.eyeBlink_L``.

    Returns:
        The shared spelling, such as ``eyeblinkleft``.
    """
    return full_name(name.rpartition(".")[2]).lower().replace("_", "").replace(" ", "")
