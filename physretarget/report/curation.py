"""Curation: which clips of a library are worth keeping, as a table, a condition and a summary.

A row is one clip with its verdict, cause, clean ranges and every measure; a condition is a
comparison of its columns, as in ``unexplained_force_rms_bw < 0.3 and verdict == 'passed'``.
"""

from __future__ import annotations

import ast
import csv
import io
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from physretarget.errors import MissingExtraError, UsageError
from physretarget.report.words import count, duration
from physretarget.validation.report import Report

Row = dict[str, Any]
Condition = Callable[[Row], bool]

_LONGEST_CONDITION = 1000  # characters; its tree then is no deeper than Python's parser allows
_RANGES = 3  # of the clean ranges the longest, in the table
_LISTED = 30  # clips named in a summary
_NO_REPORT = "not read"

_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
    ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip


def row(report: Report) -> Row:
    """One clip as a row: facts, verdict, codes, cause, clean ranges, then every measure.

    Measures that could not be taken are None. ``clean_ranges`` are the longest stretches without
    an error, in seconds, the longest first; ``clean_s`` is the length of all of them.
    """
    clean = report.clean_ranges()
    longest = sorted(clean, key=lambda r: (r[0] - r[1], r[0]))[:_RANGES]
    cause = report.causes[0] if report.causes else None
    return {
        "clip": report.clip.path,
        "verdict": report.verdict,
        "reason": report.not_judged or "",
        "errors": report.errors,
        "warnings": report.warnings,
        "codes": " ".join(sorted({f.code for f in report.findings if f.severity == "error"})),
        "cause": cause.code if cause else "",
        "cause_message": cause.message if cause else "",
        "duration_s": round(report.clip.duration_s, 6),
        "frames": report.clip.frames,
        "fps": round(report.clip.fps, 6),
        "clean_s": round(sum(b - a for a, b in clean), 6),
        "clean_ranges": " ".join(f"{a:.3f}-{b:.3f}" for a, b in longest),
        "sha256": report.clip.sha256,
        **{name: measure.value for name, measure in report.measures.items()},
    }


def rows(
    reports: Iterable[Report], unread: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[str], list[Row]]:
    """Column names and rows of many clips, those too that could not be read: "not read".

    A column is there if any clip has it.
    """
    table = [row(report) for report in reports]
    columns = dict.fromkeys(name for one in table for name in one)
    if unread:
        columns = dict.fromkeys(("clip", "verdict", "reason")) | columns
    table += [{"clip": path, "verdict": _NO_REPORT, "reason": why} for path, why in unread.items()]
    return list(columns), table


def render_csv(
    reports: Report | Sequence[Report], unread: Mapping[str, str] = MappingProxyType({})
) -> str:
    """A row a clip as CSV (RFC 4180, empty where there is no value); numbers in full."""
    columns, table = rows([reports] if isinstance(reports, Report) else reports, unread)
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in one.items()} for one in table)
    return out.getvalue()


def render_parquet(
    reports: Report | Sequence[Report], unread: Mapping[str, str] = MappingProxyType({})
) -> bytes:
    """A row a clip as Apache Parquet, null where there is no value.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise MissingExtraError("pyarrow", extra="parquet", purpose="A table as Parquet") from error
    columns, table = rows([reports] if isinstance(reports, Report) else reports, unread)
    content = pyarrow.table({name: [one.get(name) for one in table] for name in columns})
    out = io.BytesIO()
    parquet.write_table(content, out)
    return out.getvalue()


def parse_condition(text: str) -> Condition:
    """What decides about a row, from a condition in Python's words; nothing in it is executed.

    Names are columns; besides there are numbers, quoted texts, lists of them, ``True``, ``False``,
    ``< <= > >= == !=``, ``in``, ``not in``, ``and``, ``or``, ``not`` and brackets. A comparison
    with a measure that could not be taken is false.

    Raises:
        UsageError: it is no such condition; later, where a column is missing or no number.
    """
    if len(text) > _LONGEST_CONDITION:
        raise UsageError(f"--where is longer than {_LONGEST_CONDITION} characters.")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise UsageError(
            f'--where {text!r} is no condition such as "errors == 0 and duration_s > 2".'
        ) from error
    return _compile(tree, text)


def _compile(node: ast.expr, text: str) -> Condition:
    match node:
        case ast.BoolOp(op=ast.And(), values=values):
            parts = [_compile(value, text) for value in values]
            return lambda r: all(part(r) for part in parts)
        case ast.BoolOp(values=values):
            parts = [_compile(value, text) for value in values]
            return lambda r: any(part(r) for part in parts)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            inner = _compile(operand, text)
            return lambda r: not inner(r)
        case ast.Compare(left=left, ops=ops, comparators=others):
            terms = [_term(term, text) for term in (left, *others)]
            tests = [_COMPARISONS[type(op)] for op in ops if type(op) in _COMPARISONS]
            if len(tests) == len(ops):
                return lambda r: _holds([term(r) for term in terms], tests, text)
    raise UsageError(
        f"--where {text!r}: {ast.unparse(node)[:60]!r} is neither a comparison nor and, or, not."
    )


def _holds(values: Sequence[Any], tests: Sequence[Callable[[Any, Any], bool]], text: str) -> bool:
    if any(value is None for value in values):
        return False
    try:
        pairs = zip(tests, values[:-1], values[1:], strict=True)
        return all(test(left, right) for test, left, right in pairs)
    except TypeError as error:
        raise UsageError(
            f"--where {text!r} compares a number with a text: "
            f"{' and '.join(repr(value) for value in values)}."
        ) from error


def _term(node: ast.expr, text: str) -> Callable[[Row], Any]:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() as value):
            return lambda r: value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return lambda r: -value
        case ast.List(elts=elements) | ast.Tuple(elts=elements):
            terms = [_term(element, text) for element in elements]
            return lambda r: [term(r) for term in terms]
        case ast.Name(id=name):
            return lambda r: _column(r, name, text)
    raise UsageError(
        f"--where {text!r}: {ast.unparse(node)[:60]!r} is neither a column, a number nor a text."
    )


def _column(one: Row, name: str, text: str) -> Any:
    try:
        return one[name]
    except KeyError:
        raise UsageError(
            f"--where {text!r}: there is no column {name!r}; there are {', '.join(one)}."
        ) from None


def render_summary(
    reports: Sequence[Report], unread: Mapping[str, str] = MappingProxyType({})
) -> str:
    """What a library is worth, for a terminal: verdicts in hours, causes, the worst clips."""
    lines = [_hours(reports)]
    lines += _grouped("Probable causes", Counter(r.causes[0].code for r in reports if r.causes))
    codes = Counter(
        code for r in reports for code in {f.code for f in r.findings if f.severity == "error"}
    )
    lines += _grouped("Clips with errors of", codes)
    worst = sorted(reports, key=_rank)
    for report in worst[:_LISTED]:
        lines.append(_line(report))
    if len(worst) > _LISTED:
        lines.append(f"  and {count(len(worst) - _LISTED, 'clip')} more; --format csv has them all")
    lines += [f"  not read: {why}" for why in list(unread.values())[:_LISTED]]
    return "\n".join(lines) + "\n"


def _hours(reports: Sequence[Report]) -> str:
    total = sum(r.clip.duration_s for r in reports)
    parts = []
    for verdict in ("passed", "failed", "not judged"):
        mine = [r for r in reports if r.verdict == verdict]
        if mine:
            length = duration(sum(r.clip.duration_s for r in mine))
            parts.append(f"{len(mine)} {verdict} ({length})")
    saved = sum(b - a for r in reports if r.verdict == "failed" for a, b in r.clean_ranges())
    clean = f"; {duration(saved)} of the failed are clean" if saved else ""
    return f"{count(len(reports), 'clip')}, {duration(total)}: {', '.join(parts) or 'none'}{clean}."


def _grouped(title: str, counts: Counter[str]) -> list[str]:
    if not counts:
        return []
    return [f"{title}: " + ", ".join(f"{code} {n}" for code, n in counts.most_common()) + "."]


def _rank(report: Report) -> tuple[int, int, str]:
    order = {"failed": 0, "not judged": 1, "passed": 2}
    return order[report.verdict], -report.errors, report.clip.path


def _line(report: Report) -> str:
    text = f"  {report.clip.path}  {report.verdict}"
    if report.findings:
        text += f": {count(report.errors, 'error')}, {count(report.warnings, 'warning')}"
        worst = report.findings[0]
        place = "" if worst.time_s is None else f" at {worst.time_s:.2f} s"
        text += f"; {report.causes[0].code if report.causes else worst.code}{place}"
    elif report.not_judged:
        text += f": {report.not_judged}"
    return text


def _cell(value: Any) -> Any:
    return "" if value is None else value
