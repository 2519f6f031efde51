"""The rules themselves as text: a table of all, one in full, and the page docs/rules.md.

Run ``python -m physretarget.report.rules > docs/rules.md`` after changing a rule.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from physretarget.validation import RULES, Rule

_FAMILIES = {
    "DAT": "The data", "MDL": "The model", "KIN": "Kinematics", "CON": "Contact",
    "DYN": "Dynamics", "SIM": "Simulation, with `--simulate`",
}  # fmt: skip
_HEAD = """# Rules

Written from the rules themselves by `python -m physretarget.report.rules`; the same text
is printed by `physretarget rules [CODE]`. Forces count in body weights (BW), moments in body
weight times CoM height in the reference pose (BW h), rates in seconds. "ours" marks thresholds
without a published source. Limits can be set in a TOML file, see `[limits.CODE]` in
[measures](measures.md). How small a fault they find, and which causes they name, is measured in
[planted faults](measured/planted-faults.md); what they say of exact simulations in
[simulations](measured/simulations.md).
"""


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


def rules_page() -> str:
    """The whole page."""
    parts = [_HEAD]
    for family, title in _FAMILIES.items():
        parts.append(f"## {family}: {title.lower()}\n")
        parts += [_rule_section(rule) for rule in RULES if rule.family == family]
    return "\n".join(parts)


def _rule_section(rule: Rule) -> str:
    """One rule as Markdown."""
    lines = [f"### {rule.code} {rule.name}", "", rule.summary, ""]
    for title, text in rule.sections.items():
        lines += [f"**{title}.** {' '.join(text.split())}", ""]
    if rule.limits:
        lines += ["| limit | animation | robot | unit | source |", "|---|---:|---:|---|---|"]
        for name, limit in rule.limits.items():
            animation, robot = limit.under("animation"), limit.under("robot")
            lines.append(f"| {name} | {animation:g} | {robot:g} | {limit.unit} | {limit.source} |")
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(rules_page())
