"""What is worth keeping of a library: the table, the condition, the clean ranges."""

from __future__ import annotations

import contextlib
import csv
import io
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.errors import PhysretargetError, UsageError
from physretarget.report.curation import (
    parse_condition,
    render_csv,
    render_parquet,
    render_summary,
    row,
)
from physretarget.validation.report import (
    Cause,
    ClipFacts,
    Coverage,
    Finding,
    Measure,
    ModelFacts,
    Report,
    UsedSettings,
)


def report(*spans: tuple[int, int] | None, path: str = "walk.csv", judged: bool = True) -> Report:
    """A clip of ten seconds at 10 frames/s with errors in these frames (None: of the whole)."""
    status = "checked" if judged else "not-covered"
    return Report(
        tool={},
        clip=ClipFacts(path=path, sha256="ab", frames=101, duration_s=10.0, fps=10.0),
        model=ModelFacts(path="m.xml", sha256="cd", mass_kg=30.0, com_height_m=0.7),
        settings=UsedSettings(
            profile="robot", lowpass_hz=None, derivative="central", contact_tolerance_m=0.02,
            friction=1.0, floor_height_m=0.0, contact="",
        ),
        measures={
            "float_time_s": Measure(value=0.1, unit="s"),
            "skate_distance_m": Measure(value=None, unit="m"),
        },
        findings=tuple(
            Finding(
                code="DYN001", rule="r", severity="error", message="m",
                frame_first=span[0] if span else None, frame_last=span[1] if span else None,
            )
            for span in spans
        ),
        coverage=(Coverage(code="DYN001", status=status, reason="" if judged else "no mass"),),
        causes=(Cause(code="DAT013", message="y is up", remedy="turn it"),) if spans else (),
    )  # fmt: skip


def flat(ranges: list[tuple[float, float]]) -> list[float]:
    return [end for one in ranges for end in one]


def test_clean_ranges_are_what_errors_leave() -> None:
    assert report().clean_ranges() == [(0.0, 10.0)]
    assert flat(report((30, 40)).clean_ranges()) == pytest.approx([0.0, 2.9, 4.1, 10.0])
    assert report((0, 94)).clean_ranges() == [], "half a second is of no use"
    assert flat(report((0, 94)).clean_ranges(shortest_s=0.3)) == pytest.approx([9.5, 10.0])
    assert report(None).clean_ranges() == []
    assert flat(report((30, 40), (20, 60)).clean_ranges()) == pytest.approx([0.0, 1.9, 6.1, 10.0])


def test_warnings_do_not_dirty_a_range() -> None:
    warned = replace(report((30, 40)).findings[0], severity="warning")
    assert replace(report(), findings=(warned,)).clean_ranges() == [(0.0, 10.0)]


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("verdict == 'failed'", True),
        ("errors == 2 and float_time_s < 0.3", True),
        ("not (errors == 2)", False),
        ("1 < errors <= 2", True),
        ("cause in ['DAT013', 'DAT014']", True),
        ("'DYN' in codes", True),
        ("duration_s > 20 or clean_s > -1", True),
        ("skate_distance_m < 1", False),
        ("skate_distance_m > 1", False),
    ],
)
def test_conditions(text: str, holds: bool) -> None:
    assert parse_condition(text)(row(report((30, 40), (50, 60)))) is holds


@pytest.mark.parametrize(
    "text",
    [
        "", "errors", "errors = 2", "__import__('os').system('true') == 0", "errors.real == 1",
        "[x for x in y] == 1", "(lambda: 1)() == 1", "errors == 2; 1", "no_such == 1",
        "errors < 'two'", "f'{errors}' == '2'", "errors ** 9 ** 9 ** 9 == 1", "1" * 2000,
        "not " * 200 + "errors", "errors is 2", "b'x' == errors", "1j == errors",
    ],
)  # fmt: skip
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--where"):
        parse_condition(text)(row(report((30, 40))))


@given(st.text(alphabet="errorsclip()[]'<>=!.,*-+ andotin0123456789{}:", max_size=60))
def test_any_text_is_a_condition_or_refused(text: str) -> None:
    with contextlib.suppress(PhysretargetError):
        assert parse_condition(text)(row(report((30, 40)))) in (True, False)


def test_a_row_a_clip() -> None:
    many = [report(path="a,b.csv"), report((30, 40), path="c.csv")]
    table = list(csv.DictReader(io.StringIO(render_csv(many, {"d.csv": "no rows"}))))
    assert [one["clip"] for one in table] == ["a,b.csv", "c.csv", "d.csv"]
    assert [one["verdict"] for one in table] == ["passed", "failed", "not read"]
    assert float(table[1]["clean_s"]) == pytest.approx(8.8)
    assert table[1]["clean_ranges"] == "4.100-10.000 0.000-2.900"
    assert table[1]["skate_distance_m"] == ""
    assert float(table[0]["float_time_s"]) == 0.1
    assert table[2]["reason"] == "no rows"


def test_parquet_has_the_same_rows() -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    many = [report(), report((30, 40))]
    content = render_parquet(many, {"d.csv": "no rows"})
    table = parquet.read_table(io.BytesIO(content)).to_pylist()
    assert [one["verdict"] for one in table] == ["passed", "failed", "not read"]
    assert table[0]["skate_distance_m"] is None
    assert table[1]["errors"] == 1


def test_a_summary_says_what_a_library_is_worth() -> None:
    many = [report((30, 40), path=f"bad{i}.csv") for i in range(40)]
    text = render_summary([*many, report(path="good.csv"), report(path="odd.csv", judged=False)])
    assert text.startswith("42 clips, 7 min 0 s: 1 passed (10.0 s), 40 failed (6 min 40 s), ")
    assert "5 min 52 s of the failed are clean" in text
    assert "Probable causes: DAT013 40." in text
    assert len(text.splitlines()) < 40, "not a line for every clip"
