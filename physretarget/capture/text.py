"""Text files as other programs write them: codings, decimal commas, other separators."""

from __future__ import annotations

import re
from collections.abc import Sequence

_POINT = re.compile(r"\d\.|\.\d")
_WITH_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


def decoded(content: bytes) -> str:
    """The text of a file: UTF-8, or UTF-16 with its mark, as Windows' editors save "Unicode"."""
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return content.decode("utf-16" if wide else "utf-8-sig", errors="replace")


def plain_numbers(lines: Sequence[str]) -> tuple[Sequence[str], tuple[str, ...]]:
    """Lines with decimal points and white space between numbers, and what was odd about them.

    A comma is a decimal one where no number has a point and no word has two commas; elsewhere
    it stands between numbers, as a semicolon does.
    """
    if not any("," in line or ";" in line for line in lines):
        return lines, ()
    spaced = [line.replace(";", " ") for line in lines]
    words = [word for line in spaced if "," in line for word in line.split() if "," in word]
    decimal = all(_WITH_COMMA.fullmatch(word) for word in words) and not any(
        _POINT.search(line) for line in lines
    )
    if not decimal:
        return [line.replace(",", " ") for line in spaced], ()
    note = ("decimal commas were read as points",) if words else ()
    return [line.replace(",", ".") for line in spaced], note
