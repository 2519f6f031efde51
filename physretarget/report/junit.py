"""Reports as JUnit XML: a suite per clip, a case per rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from xml.etree import ElementTree as Xml

from physretarget.validation.codes import BY_CODE
from physretarget.validation.report import Finding, Report


def render_junit(
    reports: Report | Sequence[Report],
    *,
    fail_on: str = "error",
    unread: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Rules with findings at or above ``fail_on`` fail, rules not covered are skipped.

    ``unread`` are clips that could not be judged, and why: each a suite with an error.
    """
    many = [reports] if isinstance(reports, Report) else list(reports)
    root = Xml.Element("testsuites", name="physretarget")
    for report in many:
        _suite(root, report, fail_on)
    for path, why in unread.items():
        _broken(root, path, why)
    Xml.indent(root)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root, encoding="unicode") + "\n"
    )


def _suite(root: Xml.Element, report: Report, fail_on: str) -> None:
    suite = Xml.SubElement(root, "testsuite", name=_clean(report.clip.path))
    failures = skipped = 0
    for entry in report.coverage:
        rule = BY_CODE[entry.code]
        case = Xml.SubElement(
            suite, "testcase", classname=_clean(report.clip.path), name=f"{rule.code} {rule.name}"
        )
        mine = [f for f in report.findings if f.code == entry.code]
        failing = [f for f in mine if f.severity == "error" or fail_on == "warning"]
        if entry.status == "not-covered":
            Xml.SubElement(case, "skipped", message=_clean(entry.reason))
            skipped += 1
        elif failing:
            failure = Xml.SubElement(
                case, "failure", type=failing[0].severity, message=_clean(failing[0].message)
            )
            failure.text = "\n".join(_line(f) for f in failing)
            failures += 1
        noted = [f for f in mine if f not in failing]
        if noted:
            Xml.SubElement(case, "system-out").text = "\n".join(_line(f) for f in noted)
    lines = [f"verdict: {report.verdict}"]
    if report.not_judged is not None:
        lines.append(f"not judged: {report.not_judged}")
    lines += [f"probable cause ({c.code}): {c.message}. {c.remedy}." for c in report.causes]
    Xml.SubElement(suite, "system-out").text = _clean("\n".join(lines))
    suite.set("tests", str(len(report.coverage)))
    suite.set("failures", str(failures))
    suite.set("skipped", str(skipped))
    suite.set("errors", "0")


def _broken(root: Xml.Element, path: str, why: str) -> None:
    suite = Xml.SubElement(
        root, "testsuite", name=_clean(path), tests="1", failures="0", skipped="0", errors="1"
    )
    case = Xml.SubElement(suite, "testcase", classname=_clean(path), name="can be judged")
    Xml.SubElement(case, "error", message=_clean(why))


def _line(finding: Finding) -> str:
    where = "" if finding.frame_first is None else (
        f" frames {finding.frame_first}-{finding.frame_last}, look at {finding.frame}"
    )  # fmt: skip
    return _clean(f"{finding.severity}{where}: {finding.message}")


def _clean(text: str) -> str:
    """Text without the control characters that XML forbids."""
    return "".join(c for c in text if c in "\t\n" or ord(c) >= 32)
