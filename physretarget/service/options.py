"""A job's options: the command line's names; an unknown one is an error, never ignored."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from physretarget.errors import UsageError
from physretarget.service.errors import ApiError

_Hz = Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)]
_Fps = Annotated[float, Field(gt=0, le=10_000, allow_inf_nan=False)]
_Code = Annotated[str, Field(pattern=r"^[A-Z]{1,8}[0-9]{0,4}$")]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
Codes = Annotated[list[_Code], Field(max_length=200)]


class _Judged(BaseModel):
    """How the motion is judged."""

    model_config = ConfigDict(extra="forbid", strict=True)
    profile: Literal["animation", "robot"] | None = None
    select: Codes = []
    ignore: Codes = []
    thresholds: dict[_Code, dict[Annotated[str, Field(max_length=80)], _Finite]] = Field(
        default={}, description="Limits of rules: {CODE: {name: value}}."
    )
    severity: dict[_Code, Literal["error", "warning"]] = {}
    friction: Annotated[float, Field(gt=0, le=10, allow_inf_nan=False)] | None = None
    fps: _Fps | None = None


class ValidateOptions(_Judged):
    """Options of a validation."""

    lowpass: _Hz | None = Field(default=None, description="Low-pass before judging, Hz.")
    quat: Literal["wxyz", "xyzw"] | None = None
    joint_order: Literal["model", "breadth-first"] | None = None


class RetargetOptions(_Judged):
    """Options of a retargeting."""

    lowpass: Annotated[float, Field(ge=0, le=1000, allow_inf_nan=False)] = Field(
        default=6.0, description="Low-pass of the capture in Hz; 0 for none."
    )
    mapper: Literal["sgplvm", "gp", "pca", "nn3", "nn10"] = "sgplvm"
    dims: Annotated[int, Field(ge=1, le=200)] = 30
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    physics: Literal["default", "paper", "convex"] = "default"
    heading: Literal["actor", "momentum"] = "actor"
    tail: Literal["mapped", "passive"] = "mapped"
    unit: Literal["m", "cm", "mm", "inch"] | None = None
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    mass: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] | None = None


def read_options(kind: str, text: str | None) -> dict[str, Any]:
    """The options as plain data, only those that were told.

    Raises:
        ApiError: 422, naming the option.
    """
    try:
        given = json.loads(text, parse_constant=_no_constant) if text else {}
    except (ValueError, RecursionError) as error:
        raise ApiError(422, "The options are not valid JSON.", field="options") from error
    made = RetargetOptions if kind == "retarget" else ValidateOptions
    try:
        options = made.model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(("options", *(str(p) for p in first["loc"])))
        message = f"{first['msg']}."
        if first["type"] == "extra_forbidden" and len(first["loc"]) == 1:
            names = ", ".join(sorted(made.model_fields))
            message = f"There is no such option; there are {names}."
        raise ApiError(422, message, field=_plain(place)) from error
    _check_codes(options)
    return options.model_dump(exclude_unset=True)


def _check_codes(options: _Judged) -> None:
    if not (options.select or options.ignore or options.severity or options.thresholds):
        return
    # The rules bring MuJoCo along, which the server needs for nothing else.
    from physretarget.validation.codes import RULES
    from physretarget.validation.config import check_codes

    limits = {rule.code: rule.limits for rule in RULES}
    try:
        check_codes((*options.select, *options.ignore, *options.severity), RULES)
        for code, values in options.thresholds.items():
            if code not in limits:
                raise UsageError(f"no rule has the code '{code}'.")
            for name, value in values.items():
                if name not in limits[code]:
                    raise UsageError(
                        f"{code} has no limit '{_plain(name)}', it has "
                        f"{', '.join(limits[code]) or 'none'}."
                    )
                assert math.isfinite(value)
    except UsageError as error:
        raise ApiError(422, _sentence(str(error)), field="options") from error


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _plain(text: str) -> str:
    """Text of a client that may hold anything, lone surrogates too."""
    return "".join(c if c.isprintable() else "_" for c in text)[:200]


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")
