from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from physretarget.clip import Clip
from physretarget.errors import UsageError
from physretarget.kinematics import runs
from physretarget.mjcf import Character
from physretarget.report import retarget_html
from physretarget.report.charts import Chart, Series, finding_lanes, latent_plot
from physretarget.report.document import document_marks, measure_tiles
from physretarget.report.html import render_html
from physretarget.report.retarget_data import (
    ForceCurves,
    KeyNumber,
    LatentMap,
    MomentumCurves,
    RetargetReport,
    StageMotion,
)
from physretarget.report.retarget_html import render_retarget_html
from physretarget.report.words import duration, look, number, quantity
from physretarget.validation import validate

HOSTILE = 'x"><script>alert(1)</script>'
BALL = """<mujoco model="ball"><worldbody><geom type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 0.1"><freejoint/><geom type="sphere" size="0.1" mass="1"/>
  <site name="contact_low" pos="0 0 -0.1"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def ball() -> Character:
    return Character.from_xml(BALL, name="ball")


@pytest.fixture(scope="module")
def clip() -> Clip:
    time = np.arange(60) / 30.0
    qpos = np.tile([0.0, 0, 0.1, 1, 0, 0, 0], (60, 1))
    qpos[:, 2] += 0.2 * np.sin(np.pi * time) ** 2
    return Clip(qpos=qpos, time=time, joint_names=("j",), path=f"/data/{HOSTILE}.npz")


@pytest.fixture
def document() -> dict:
    finding = {
        "code": "DYN001", "rule": "r", "severity": "error", "message": HOSTILE,
        "frame_first": 10, "frame_last": 20, "frame": 12, "time_s": 0.4, "body": "ball",
        "value": 0.31, "limit": 0.05, "unit": "BW",
    }  # fmt: skip
    whole = finding | {
        "code": "MDL001", "severity": "warning", "frame_first": None, "frame_last": None,
        "frame": None, "time_s": None, "value": None, "limit": None,
    }  # fmt: skip
    return {
        "schema": "physretarget/report/1",
        "tool": {"name": "physretarget", "version": "0"},
        "clip": {"path": HOSTILE, "sha256": "ab", "frames": 60, "duration_s": 2.0},
        "model": {"path": "/m/ball.xml", "sha256": "cd", "mass_kg": 1.0, "com_height_m": 0.1},
        "settings": {"profile": "animation", "lowpass_hz": 6.0},
        "measures": {
            "required_force_vertical_max_bw": {"value": 2.414, "unit": "BW", "frame": 7},
            "penetration_max_m": {"value": None, "unit": "m", "frame": None},
        },
        "findings": [finding, whole],
        "coverage": [
            {"code": "DYN001", "status": "checked", "reason": ""},
            {"code": "DYN004", "status": "not-covered", "reason": "No torque limits."},
        ],
        "summary": {"errors": 1, "warnings": 1, "passed": False},
    }


@pytest.fixture
def retargeting(ball: Character, clip: Clip, document: dict) -> RetargetReport:
    t = clip.time
    wave = np.sin(t)
    return RetargetReport(
        title=HOSTILE,
        capture="jump.bvh",
        time=t,
        actor=ball,
        actor_qpos=clip.qpos,
        character=ball,
        character_name="Ball",
        stages=(
            StageMotion(label="mapped", qpos=clip.qpos, note=HOSTILE),
            StageMotion(label="physical", qpos=clip.qpos),
        ),
        contact_active=np.ones((60, 1), dtype=bool),
        momentum=(MomentumCurves(axis="forward", target=wave, achieved=wave),),
        force=ForceCurves(
            required_before=3 * wave, contact_before=wave, required_after=wave, contact_after=wave
        ),
        latent=(
            LatentMap(
                label="2 dimensions",
                trajectory=np.stack([wave, t], axis=1),
                key_poses=np.array([[0.0, 0.0], [0.5, 1.0]]),
                own=np.array([True, False]),
                names=(HOSTILE, "b"),
                variance=np.arange(12.0).reshape(3, 4),
                extent=(-1, 1, 0, 2),
            ),
        ),
        numbers=(KeyNumber(label="Mismatch", value=0.123456, unit="BW", good=True),),
        report=document,
        sections={"Inputs": {"capture": HOSTILE}},
    )


class Reader(HTMLParser):
    """Tags with their attributes, and the JSON that the page carries."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.data = ""
        self._inside = False
        self.feed(page)

    def handle_starttag(self, tag, attributes) -> None:
        self.tags.append((tag, dict(attributes)))
        self._inside = dict(attributes).get("id") == "page-data"

    def handle_endtag(self, tag) -> None:
        self._inside = False

    def handle_data(self, data) -> None:
        if self._inside:
            self.data += data

    def named(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.tags if name == tag]


def test_hostile_names_stay_text(ball, clip, document, retargeting) -> None:
    for page in (render_html(document, clip, ball), render_retarget_html(retargeting)):
        assert "<script>alert" not in page
        assert page.count("<script") == page.count("</script>")
        read = Reader(page)
        assert len(read.named("script")) == page.count("<script")
        assert not any("src" in a for a in read.named("script"))
        assert not any(k.startswith("on") for _, a in read.tags for k in a)


def test_pages_load_nothing(ball, clip, document, retargeting) -> None:
    for page in (render_html(document, clip, ball), render_retarget_html(retargeting)):
        read = Reader(page)
        assert not read.named("link")
        assert not read.named("iframe")
        for image in (*read.named("image"), *read.named("img")):
            assert (image.get("href") or image.get("src")).startswith("data:image/png;base64,")


def test_a_finding_jumps_to_its_worst_frame(ball, clip, document) -> None:
    read = Reader(render_html(document, clip, ball))
    rows = [a["data-frame"] for a in read.named("tr") if "data-frame" in a]
    assert rows == ["12", "7"]  # the finding, then the measure
    scene = json.loads(read.data)["scene"]
    assert [(m["first"], m["last"], m["look"]) for m in scene["marks"]] == [(10, 20, 12)]
    assert json.loads(read.data)["spans"] == [[10, 20]]


def test_rows_that_jump_match_the_spans_they_light_up(ball, clip, document) -> None:
    """The page pairs rows of the findings table with spans by position."""
    document["findings"] = [document["findings"][i] for i in (1, 0, 1, 0)]
    page = render_html(document, clip, ball)
    table = page.split('<table class="findings">')[1].split("</table>")[0]
    assert table.count("<tr data-frame") == len(json.loads(Reader(page).data)["spans"]) == 2


def test_very_many_findings_are_cut_and_counted(ball, clip, document) -> None:
    document["findings"] = [document["findings"][0]] * 450
    page = render_html(document, clip, ball)
    assert "150 more findings" in page


def test_coverage_is_shown_uncovered_first_and_why(ball, clip, document) -> None:
    page = render_html(document, clip, ball)
    assert "1 of 2 rules could be checked" in page
    assert "No torque limits." in page
    table = page.split('<table class="coverage">')[1]
    assert table.index("DYN004") < table.index("DYN001")


def test_a_real_report(ball, clip) -> None:
    report = validate(clip, ball)
    data = json.loads(Reader(render_html(report, clip, ball)).data)
    assert "series-force" in data["charts"]
    drawn = data["charts"]["series-force"]["series"][0]
    assert drawn["label"] == "required"
    values = np.frombuffer(base64.b64decode(drawn["values"]["f32"]), "<f4")
    np.testing.assert_allclose(values, report.series["required_force_vertical_bw"], rtol=1e-6)


def test_every_chart_in_the_page_has_its_data(ball, clip, retargeting) -> None:
    for page in (render_html(validate(clip, ball), clip, ball), render_retarget_html(retargeting)):
        read = Reader(page)
        places = [a["data-chart"] for a in read.named("div") if "data-chart" in a]
        assert sorted(places) == sorted(json.loads(read.data)["charts"])


def test_before_and_after_share_a_scale(retargeting) -> None:
    charts = json.loads(Reader(render_retarget_html(retargeting)).data)["charts"]
    assert charts["force-before"]["range"] == charts["force-after"]["range"]
    low, high = charts["force-before"]["range"]
    assert low < 0
    assert high > 3.0


def test_the_clip_stands_beside_its_actor(retargeting) -> None:
    data = json.loads(Reader(render_retarget_html(retargeting)).data)
    figures = data["scene"]["figures"]
    assert [(f["name"], f["hidden"]) for f in figures] == [
        ("Actor", False), ("Ball", False), ("mapped", True),
    ]  # fmt: skip
    assert [row["figure"] for row in data["strip"]["rows"]] == [0, 2, 1]
    assert len(data["strip"]["times"]) == 8


def test_a_large_figure_is_no_power_of_ten(document) -> None:
    document["measures"]["skate_speed_max_m_s"] = {"value": 9.66e-09, "unit": "m/s", "frame": 3}
    shown = {tile["label"]: tile["value"] for tile in measure_tiles(document)}
    assert shown["Fastest foot slide"] == "< 0.0001"
    assert shown["Vertical force, highest"] == "2.41"


def test_every_number_says_of_what_it_is(retargeting) -> None:
    tile = KeyNumber(label="Vertical mismatch", stage="physical", value=-94.0, unit="%")
    page = render_retarget_html(replace(retargeting, numbers=(tile,)))
    clip, way = page.split("The clip, as the validator measured it")[1].split("The way there", 1)
    assert "Vertical force, highest" in clip
    assert "Vertical mismatch <small>after physical</small>" in way
    unjudged = render_retarget_html(replace(retargeting, numbers=(tile,), report=None))
    assert "as the validator measured it" not in unjudged


def test_a_painted_strip_has_a_still_for_every_row(retargeting, monkeypatch) -> None:
    seen = []

    def painted(rows):
        seen.extend(rows)
        return tuple(f"still {k}" for k in range(len(rows)))

    monkeypatch.setattr(retarget_html, "stills", painted)
    page = render_retarget_html(retargeting, painted=True)
    rows = json.loads(Reader(page).data)["strip"]["rows"]
    assert [row["still"] for row in rows] == ["still 0", "still 1", "still 2"]
    assert [row.figure.name for row in seen] == ["Actor", "mapped", "Ball"]
    assert [list(row.frames) for row in seen] == 3 * [[4, 11, 18, 26, 33, 41, 48, 55]]
    page = render_retarget_html(retargeting)
    assert {row["still"] for row in json.loads(Reader(page).data)["strip"]["rows"]} == {""}


def test_a_retargeting_that_was_not_judged_says_so(retargeting) -> None:
    page = render_retarget_html(replace(retargeting, report=None, latent=(), force=None))
    assert "was not judged" in page
    assert "nothing is covered" in page
    assert "passed</span>" not in page


def test_tracks_must_share_the_clock(retargeting) -> None:
    with pytest.raises(UsageError, match="the actor has 59"):
        replace(retargeting, actor_qpos=retargeting.actor_qpos[1:])


def test_same_data_same_bytes(retargeting) -> None:
    assert render_retarget_html(retargeting) == render_retarget_html(retargeting)


def test_the_latent_map_is_drawn_right_way_up(retargeting) -> None:
    plot = latent_plot(retargeting.latent[0])
    assert plot.own == ((50.0, 100.0, HOSTILE),)  # y = 0 is the lowest row: bottom of the box
    assert plot.other == ((75.0, 50.0, "b"),)
    from matplotlib.image import imread

    raw = base64.b64decode(plot.image.split(",")[1])
    import io

    pixels = imread(io.BytesIO(raw))
    assert pixels.shape[:2] == (3, 4)
    assert pixels[-1, 0, :3].sum() > pixels[0, -1, :3].sum()  # low variance is pale, and below


def test_runs_and_lanes() -> None:
    assert runs(np.array([1, 1, 0, 1], dtype=bool)) == [(0, 1), (3, 3)]
    assert runs(np.zeros(3, dtype=bool)) == []
    base = {"message": "m", "frame_last": None}
    marks = document_marks(
        {
            "findings": [
                base | {"code": "B", "severity": "warning", "frame_first": 1},
                base | {"code": "C", "severity": "error", "frame_first": 5},
                base | {"code": "B", "severity": "warning", "frame_first": 9},
            ]
        }
    )
    lanes = finding_lanes(marks)
    assert [(lane.label, len(lane.spans)) for lane in lanes] == [("C", 1), ("B", 2)]


def test_gaps_survive_in_charts() -> None:
    chart = Chart("a", "A", "m", (Series("s", np.array([1.0, np.nan]), "red"),))
    packed = chart.data()["series"][0]["values"]["f32"]
    assert np.isnan(np.frombuffer(base64.b64decode(packed), "<f4")[1])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (0.0, "0"), (0.05, "0.05"), (-0.312, "−0.312"), (1234.6, "1235"),
        (12, "12"), (True, "yes"), (float("nan"), "–"), ("a", "a"), (2.0e-7, "2e−07"),
    ],
)  # fmt: skip
def test_numbers_are_written_for_people(value, text) -> None:
    assert number(value) == text


def test_quantities_are_written_for_people() -> None:
    assert quantity(0.102, "1") == ("10.2", "%")
    assert quantity(3.5, "1") == ("3.5", "")
    assert quantity(0.0032, "m") == ("3.2", "mm")
    assert quantity(0.5, "m") == ("0.5", "m")
    assert quantity(2.5, "m/s^2") == ("2.5", "m/s²")
    assert duration(10.0) == "10.0 s"
    assert duration(600.0) == "10 min 0 s"
    assert duration(9000.0) == "2 h 30 min"
    assert look("heat_m_s") is not None


@pytest.mark.slow
def test_the_page_runs_in_a_browser(retargeting, tmp_path) -> None:
    """Everything is built without an error, and a click on a finding moves the clock."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium to open the page in")
    probe = """<script>
      setTimeout(() => {
        document.querySelector(".findings tr[data-frame]").click();
        const charts = document.querySelectorAll(".uplot").length, gl = Boolean(player.renderer);
        document.title = ["frame", player.frame, "charts", charts, "webgl", gl].join(" ");
      }, 1500);
    </script></body>"""
    page = tmp_path / "page.html"
    page.write_text(render_retarget_html(retargeting).replace("</body>", probe))
    done = subprocess.run(
        [
            browser, "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--disable-background-networking",
            "--disable-component-update", "--disable-sync", "--no-first-run",
            "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}",
            "--window-size=1000,800", "--virtual-time-budget=4000", "--dump-dom", page.as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert console == []
    title = re.search(r"<title>(.*?)</title>", done.stdout)
    assert title is not None
    assert title[1] == "frame 12 charts 5 webgl true"
