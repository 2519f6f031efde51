"""What a model would make MuJoCo allocate, added up before MuJoCo sees it.

Single numbers are bounded, and so is what they come to together: sixty pictures of the largest
size are as bad as one that is too large. Numbers in default classes count for every element,
since which class applies is MuJoCo's business.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from physretarget.sandbox.limits import MIB, Limits
from physretarget.sandbox.vocabulary import NAMING_ATTRIBUTES

# (element or "" for any, attribute): the most that each of its numbers may be.
_MOST: dict[tuple[str, str], float] = {
    ("size", "memory"): 512 * MIB,
    ("size", "nstack"): 64 * MIB,
    ("size", "njmax"): 50_000,
    ("size", "nconmax"): 50_000,
    ("size", "nuserdata"): 1_000_000,
    ("size", "nkey"): 10_000,
    ("numeric", "size"): 100_000,
    ("texture", "width"): 8192,
    ("texture", "height"): 8192 * 6,
    ("hfield", "nrow"): 4096,
    ("hfield", "ncol"): 4096,
    ("texture", "gridsize"): 12,
    ("mesh", "params"): 1000,
    ("mesh", "maxhullvert"): 100_000,
    ("camera", "resolution"): 8192,
    ("option", "iterations"): 10_000,
    ("option", "ls_iterations"): 10_000,
    ("option", "noslip_iterations"): 10_000,
    ("option", "ccd_iterations"): 10_000,
    ("option", "sdf_iterations"): 1_000,
    ("option", "sdf_initpoints"): 1_000,
    ("global", "offwidth"): 16_384,
    ("global", "offheight"): 16_384,
    ("quality", "shadowsize"): 16_384,
    ("quality", "numslices"): 1_000,
    ("quality", "numstacks"): 1_000,
    ("quality", "numquads"): 1_000,
    ("", "nsample"): 10_000,
    ("", "num"): 10_000,
    ("", "dim"): 10_000,
    ("", "nchannel"): 4,
}
_UNITS = {"k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40, "p": 2**50, "e": 2**60}
# Anything larger is no length, mass or time, and its square would be infinite in single precision.
_LARGEST = 1e18
_TEXTS = frozenset(("name", "class", "childclass", "model"))


class Budget:
    """Adds up elements and numbers; every method says what is too much, or None."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._count: Counter[str] = Counter()  # elements, repeated ones as often as repeated
        self._most: Counter[tuple[str, str]] = Counter()  # largest number seen of each kind
        self._naming = 0  # elements that name others
        self._repeated = 1  # the most that any element is repeated

    def add(self, tag: str, attributes: Mapping[str, str], times: int) -> str | None:
        """Count one element that is repeated so many times."""
        self._count[tag] += times
        self._count[""] += times
        self._naming += times if NAMING_ATTRIBUTES & attributes.keys() else 0
        self._repeated = max(self._repeated, times)
        if self._count[""] > self._limits.xml_elements:
            return f"more than {self._limits.xml_elements} elements"
        if self._count["body"] > self._limits.model_bodies:
            return f"more than {self._limits.model_bodies} bodies"
        if self._count["geom"] > self._limits.model_geoms:
            return f"more than {self._limits.model_geoms} geoms"
        for name, value in attributes.items():
            wrong = self._attribute(tag, name, value)
            if wrong:
                return wrong
        return None

    def _attribute(self, tag: str, name: str, value: str) -> str | None:
        numbers = None if name in _TEXTS else numbers_of(value)
        if numbers is None:
            return None
        if not all(abs(n) <= _LARGEST for n in numbers):
            return f"a number in '{name}' is not finite, or too large to be one of a model"
        key = ("size", "nuser") if name.startswith("nuser_") else (tag, name)
        most = 10_000 if key[1] == "nuser" else _MOST.get(key, _MOST.get(("", name)))
        if most is None:
            return None
        largest = max(numbers, default=0.0)
        if largest > most:
            return f"'{name}' asks for {value.strip()[:40]}, at most {most:g} is allowed"
        product = math.prod(n for n in numbers if n > 0) if name == "resolution" else largest
        key = key if tag in ("texture", "hfield", "camera", "size") else ("", name)
        self._most[key] = max(self._most[key], math.ceil(product))
        return None

    def total(self) -> str | None:
        """What everything comes to, when all is counted."""
        most, count = self._most, self._count
        elements = count[""] + self._naming * (self._repeated - 1)
        if elements > self._limits.xml_elements:
            return f"{elements} elements, repeated ones and what names them counted as repeated"
        # A cube has six sides one above the other, whatever height it is given.
        width, height = most["texture", "width"], most["texture", "height"]
        pixels = count["texture"] * width * max(height, 6 * width)
        if pixels > 2 * self._limits.asset_pixels:
            return f"textures of {pixels} pixels, at most {2 * self._limits.asset_pixels}"
        # What a number is asked for by, and how many elements may ask.
        numbers = (
            most["hfield", "nrow"] * most["hfield", "ncol"] * count["hfield"]
            + most["camera", "resolution"] * count["rangefinder"]
            + most["size", "nuser"] * elements
            + most["size", "nkey"] * 10 * count["joint"]
            + most["size", "nuserdata"]
            + most["", "size"] * count["numeric"]
            + (most["", "nsample"] + most["", "num"] + most["", "dim"]) * elements
        )
        if numbers > self._limits.model_numbers:
            return f"it asks for {numbers} numbers, at most {self._limits.model_numbers} are held"
        return None


def numbers_of(value: str) -> list[float] | None:
    """The numbers of an attribute, None for a text. ``64M`` is a number to MuJoCo, ``0x9`` too."""
    numbers: list[float] = []
    for word in value.split():
        number = _number(word)
        if number is None:
            return None
        numbers.append(number)
    return numbers


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        pass
    try:
        if "0x" in word[:3].lower():
            return float.fromhex(word)
        return float(word[:-1]) * _UNITS[word[-1:].lower()]
    except OverflowError:
        return math.inf
    except (ValueError, KeyError):
        return math.nan if word.lower().lstrip("+-").startswith(("nan(", "inf")) else None
