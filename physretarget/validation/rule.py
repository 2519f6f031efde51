"""What a rule is: a code, a text, and limits with their sources."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from physretarget.options.judging import Profile, Severity
from physretarget.validation.report import Cause, Finding

Limits = Mapping[str, float]
_SECTIONS = ("What it does", "Why it matters", "Threshold", "Example")


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A threshold with its unit and source; ``robot`` where that profile differs."""

    value: float
    unit: str
    source: str
    robot: float | None = None

    def under(self, profile: Profile) -> float:
        """The default under a profile.

        Args:
            profile: animation or robot.

        Returns:
            The value, in the limit's unit.
        """
        return self.robot if profile == "robot" and self.robot is not None else self.value


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What a rule says: findings, or the reason why nothing could be judged."""

    findings: tuple[Finding, ...] = ()
    not_covered: str | None = None
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One thing that is judged, see :class:`~physretarget.validation.clip_rule.ClipRule` and
    :class:`~physretarget.validation.model_rule.ModelRule`.

    ``doc`` is the rule file's docstring: its first line is the summary, then the sections What
    it does, Why it matters, Threshold, Example. ``explains`` makes it a rule that says why others
    have found errors, or anything: it is asked where they have.
    """

    code: str
    name: str
    doc: str
    limits: Mapping[str, Limit] = field(default_factory=lambda: MappingProxyType({}))
    explains: Literal["errors", "findings"] | None = None

    @property
    def family(self) -> str:
        """The three letters of the code."""
        return self.code[:3]

    @property
    def summary(self) -> str:
        """One sentence."""
        return inspect.cleandoc(self.doc).splitlines()[0]

    @property
    def sections(self) -> dict[str, str]:
        """The docstring's sections by title."""
        text = inspect.cleandoc(self.doc)
        titles = "|".join(_SECTIONS)
        parts = re.split(rf"^({titles})\n-+\n", text, flags=re.MULTILINE)
        return {t: b.strip() for t, b in zip(parts[1::2], parts[2::2], strict=True)}

    def finding(self, *, severity: Severity, message: str, **where: object) -> Finding:
        """A finding of this rule.

        Args:
            severity: error or warning.
            message: One sentence.
            where: Frames, time, body, value, limit and unit.

        Returns:
            The finding.
        """
        return Finding(
            code=self.code,
            rule=self.name,
            severity=severity,
            message=message,
            **where,  # type: ignore[arg-type]
        )
