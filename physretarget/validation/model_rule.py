"""Rules about a model, from its audit; the same for every clip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from physretarget.mjcf import Character
from physretarget.mjcf.audit import AUDIT_KEYS, AuditFact, audit
from physretarget.options.judging import Severity
from physretarget.validation.report import Finding
from physretarget.validation.rule import Judgement, Rule

_NAMED = 4


@dataclass(frozen=True, kw_only=True)
class ModelRule(Rule):
    """A rule about a model; ``errors`` and ``warnings`` are the facts of its audit that count."""

    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def check(self, character: Character) -> Judgement:
        """One finding for every kind of oddity, naming the first few places."""
        facts = audit_once(character)
        kinds: list[tuple[str, Severity]] = [(key, "error") for key in self.errors]
        kinds += [(key, "warning") for key in self.warnings]
        found: list[Finding] = []
        for key, severity in kinds:
            mine = [f for f in facts if f.key == key]
            if mine:
                found.append(_finding(self, severity, key, mine))
        return Judgement(findings=tuple(found))


@lru_cache(maxsize=8)
def audit_once(character: Character) -> tuple[AuditFact, ...]:
    """The audit of a character, kept: many clips share a model."""
    return tuple(audit(character))


def _finding(rule: Rule, severity: Severity, key: str, facts: list[AuditFact]) -> Finding:
    first = facts[0]
    if len(facts) == 1:
        message = f"{first.name}: {first.message}"
    else:
        names = ", ".join(f.name for f in facts[:_NAMED])
        more = f" and {len(facts) - _NAMED} more" if len(facts) > _NAMED else ""
        message = f"{AUDIT_KEYS[key]}: {names}{more}; the first: {first.message}"
    return rule.finding(
        severity=severity, message=message, body=first.name, unit=first.unit,
        value=_number(first.value), limit=_number(first.limit),
    )  # fmt: skip


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
