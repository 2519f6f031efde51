"""docs/rules.md, written from the rules themselves.

Run ``python -m physretarget.validation.rules_page > docs/rules.md`` after changing a rule.
"""

from __future__ import annotations

import sys

from physretarget.validation.codes import RULES
from physretarget.validation.rule import Rule

_FAMILIES = {
    "DAT": "The data", "MDL": "The model", "KIN": "Kinematics", "CON": "Contact",
    "DYN": "Dynamics",
}  # fmt: skip
_HEAD = """# Rules

Written from the rules themselves by `python -m physretarget.validation.rules_page`; the same text
is printed by `physretarget rules [CODE]`. Forces count in body weights (BW), moments in body
weight times CoM height in the reference pose (BW h), rates in seconds. "ours" marks thresholds
without a published source. Limits can be set in a TOML file, see `[limits.CODE]` in
[measures](measures.md).
"""


def rules_page() -> str:
    """The whole page."""
    parts = [_HEAD]
    for family, title in _FAMILIES.items():
        parts.append(f"## {family}: {title.lower()}\n")
        parts += [rule_page(rule) for rule in RULES if rule.family == family]
    return "\n".join(parts)


def rule_page(rule: Rule) -> str:
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
