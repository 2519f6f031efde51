"""The rules themselves as text: a table of all, one in full, and the page docs/rules.md."""

from __future__ import annotations

from collections.abc import Sequence

from physretarget.validation import Rule


def render_rules(rules: Sequence[Rule]) -> str:
    """One line a rule."""
    return "\n".join(f"{rule.code}  {rule.name:<28} {rule.summary}" for rule in rules)


def render_rule(rule: Rule) -> str:
    """One rule in full: what, why, thresholds with their sources, example."""
    lines = [f"{rule.code} {rule.name}", "", rule.summary]
    for title, body in rule.sections.items():
        lines += ["", title, body]
    if rule.limits:
        lines += ["", "Limits"]
    for name, limit in rule.limits.items():
        robot = f" (robot: {limit.robot:g})" if limit.robot is not None else ""
        lines.append(f"  {name} = {limit.value:g} {limit.unit}{robot}  {limit.source}")
    return "\n".join(lines)
