"""What every benchmark returns, and how it is told."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Row:
    """One measured number, beside what it must not miss and beside another way to do the same.

    ``value`` in ``unit``; ``aim`` is a bound on it (``higher`` says from which side);
    ``rival`` did the same job in the same run with ``rival_value`` in the same unit.
    """

    name: str
    value: float
    unit: str
    aim: float | None = None
    higher: bool = False
    rival: str = ""
    rival_value: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the aim is met; None without one."""
        if self.aim is None:
            return None
        return self.value >= self.aim if self.higher else self.value <= self.aim

    @property
    def ratio(self) -> float | None:
        """How many times better than the rival."""
        if self.rival_value is None:
            return None
        return self.value / self.rival_value if self.higher else self.rival_value / self.value


def best_of(count: int, work: Callable[[], object]) -> float:
    """Least processor time of several runs, s: the machine may be busy with other things."""
    spent = []
    for _ in range(count):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return min(spent)


def number(value: float) -> str:
    """Three digits that matter."""
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def markdown(rows: Sequence[Row]) -> str:
    """A table of rows."""
    lines = ["| what | measured | aim | the same elsewhere | ratio |", "|---|---|---|---|---|"]
    for row in rows:
        aim = ""
        if row.aim is not None:
            side = "≥" if row.higher else "≤"
            aim = f"{side} {number(row.aim)} {row.unit} {'✓' if row.met else '**missed**'}"
        rival = (
            f"{row.rival}: {number(row.rival_value)} {row.unit}" if row.rival_value else row.rival
        )
        ratio = f"{number(row.ratio)} ×" if row.ratio else ""
        name = row.name + (f" ({row.note})" if row.note else "")
        lines.append(f"| {name} | {number(row.value)} {row.unit} | {aim} | {rival} | {ratio} |")
    return "\n".join(lines)
