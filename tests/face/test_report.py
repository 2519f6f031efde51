"""The report of a take: what it says, that it is one file, and that clicks lead to sources."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.report import (
    ChannelReport,
    Origin,
    SourceSpan,
    TakeReport,
    page_data,
    render,
    take_report,
    write_report,
)
from physretarget.face.rig import Rig
from physretarget.face.shot import Shot, Take

HOSTILE = "</script><script>alert(1)</script>%%DATA%%"


@pytest.fixture(scope="module")
def report() -> TakeReport:
    time = np.arange(61) / 30.0
    curve = Curve(
        (
            Key(0.0, 0.0, out_tangent=(0.3, 0.0)),
            Key(1.0, 1.0, (-0.3, 0.0), (0.0, 0.0), "fixed", "stepped"),
            Key(2.0, 0.2),
        )
    )
    example = Curve.through([0.0, 0.5], [0.0, 3.0], "flat")
    origin = Origin(HOSTILE, "eyebrows.rotation", 1.2, 1.7, 2.0, 0.3, 0.012, 0.004, 3, example)
    spans = (
        SourceSpan(0.0, 1.0, "matched", origin, low=True),
        SourceSpan(1.0, 2.0, "locked"),
    )
    channel = ChannelReport(
        "BrowInnerUp",
        "brows",
        0.0,
        1.0,
        curve.evaluate(time),
        curve,
        spans,
        0.01,
        float("nan"),
        (1,),
    )
    return TakeReport(HOSTILE, "distance", time, (channel,), {"keys": "3"}, (), ("a note",))


class Outside(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found: list[str] = []
        self.scripts = 0

    def handle_starttag(self, tag, attrs):
        self.scripts += tag == "script"
        self.found += [v for k, v in attrs if k in ("src", "href") and not v.startswith("#")]


def test_one_file_and_hostile_names_stay_text(report):
    page = render(report)
    parser = Outside()
    parser.feed(page)
    assert parser.found == []
    assert parser.scripts == 4
    assert "alert(1)</script>" not in page
    assert "default-src 'none'" in page
    assert "@import" not in page
    assert render(report) == page


def test_data_on_the_page_is_what_was_given(report):
    page = render(report)
    text = re.findall(r'id="data">(.*?)</script>', page, re.S)[0]
    data = json.loads(text)
    assert data["title"] == HOSTILE
    (channel,) = data["channels"]
    assert channel["curve"]["t"] == [0, 1, 2]
    assert channel["curve"]["s"] == [0, 1, 0]
    assert channel["curve"]["h"][0] == [0.3, 0.0, 0.7, 1.0]
    assert channel["timing"] is None
    assert channel["locked"] == [1]
    told = channel["spans"][0]["from"]
    assert told["shot"] == HOSTILE
    assert (told["start"], told["end"], told["scale"], told["margin"]) == (1.2, 1.7, 2.0, 0.004)
    assert len(told["curve"]["t"]) == 2


def test_wrong_length_is_named(report):
    channel = report.channels[0]
    broken = ChannelReport("x", "y", 0, 1, channel.capture[:-1], channel.result)
    with pytest.raises(InputError, match="channel x"):
        page_data(TakeReport("t", "m", report.time, (broken,)))


@pytest.fixture(scope="module")
def matched():
    rng = np.random.default_rng(0)
    shots = []
    for n in range(6):
        times = np.cumsum(rng.uniform(0.2, 0.6, 7))
        shots.append(Shot(f"shot{n}", {"brow": Curve.through(times, rng.uniform(0, 1, 7))}))
    library = Library.of(shots)
    time = np.arange(90) / 30.0
    values = 0.5 + 0.4 * np.sin(time[:, None] * np.array([3.0, 4.5]))
    take = Take("take", time, ("BrowInnerUp", "EyeBlinkLeft"), values)
    rig = Rig.of(take)
    return match(take, library, rig, MatchSettings()), rig, library


def test_report_of_a_match(matched):
    result, rig, library = matched
    report = take_report(result, rig, library)
    assert [c.name for c in report.channels] == ["BrowInnerUp", "EyeBlinkLeft"]
    assert [c.group for c in report.channels] == ["brows", "lids"]
    assert report.figures["keys"] == str(result.keys)
    labels = [row[0] for row in report.comparison]
    assert labels[1:] == ["match", "decimate", "schneider", "rdp"]
    for channel in report.channels:
        inner = [k.time for k in channel.result.keys]
        for key in inner:
            assert any(s.start - 1e-6 <= key <= s.end + 1e-6 for s in channel.spans)
        for span in channel.spans:
            assert span.kind in ("matched", "plain", "rest")
            assert (span.kind == "matched") == bool(span.origin.shot)
    assert take_report(result, rig, baselines=False).comparison == ()


def test_locked_keys_are_marked(matched):
    result, rig, library = matched
    lock = Key(1.0, 0.4, (-0.1, 0.0), (0.1, 0.0))
    kept = match(result.take, library, rig, MatchSettings(), locked={"BrowInnerUp": [lock]})
    channel = take_report(kept, rig, library, baselines=False).channels[0]
    (number,) = channel.locked
    assert channel.result.keys[number] == lock
    assert page_data(take_report(kept, rig, library))["channels"][0]["locked"] == [number]


def test_two_clicks_in_a_real_browser(matched, tmp_path):
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("no Chromium: the page is not tried in a browser")
    result, rig, library = matched
    write_report(tmp_path / "r.html", take_report(result, rig, library))
    probe = """<script>
      addEventListener("error", (e) => document.body.dataset.failed = e.message);
      const out = {};
      document.querySelectorAll("nav > button")[1].click();
      setTimeout(() => {
        const u = faceReport.charts.get(1), box = u.over.getBoundingClientRect();
        const c = JSON.parse(document.getElementById("data").textContent).channels[1].curve;
        const x = box.left + u.valToPos(c.t[1], "x"), y = box.top + u.valToPos(c.v[1], "y");
        for (const kind of ["mousemove", "mousedown", "mouseup", "click"])
          u.over.dispatchEvent(new MouseEvent(kind, { clientX: x, clientY: y, bubbles: true }));
        const pre = document.createElement("pre");
        pre.id = "probe";
        pre.textContent = JSON.stringify({ said: document.getElementById("source").innerText });
        document.body.append(pre);
      }, 500);
    </script></body>"""
    page = (tmp_path / "r.html").read_text()
    at = page.rindex("</body>")
    (tmp_path / "probe.html").write_text(page[:at] + probe + page[at + 7 :])
    flags = (
        "--headless=new --no-sandbox --use-gl=angle --use-angle=swiftshader "
        "--enable-unsafe-swiftshader --disable-background-networking --disable-component-update "
        "--disable-sync --no-first-run --window-size=1400,900 --virtual-time-budget=4000 --dump-dom"
    )
    done = subprocess.run(
        [chromium, *flags.split(), f"--user-data-dir={tmp_path / 'profile'}",
         (tmp_path / "probe.html").as_uri()],
        capture_output=True, text=True, timeout=90, check=True,
    )  # fmt: skip
    assert "data-failed" not in done.stdout
    told = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert told, done.stderr[-500:]
    said = json.loads(told[1])["said"]
    assert "EyeBlinkLeft" in said
    assert "key 2 of" in said
    assert "plain ease" in said
    assert "No past shot explains" in said  # the match names a source only where one does


def test_the_face_shows_capture_and_result_at_the_moment_of_an_event(browser, tmp_path):
    """The lid closes in both heads; the result's curve agrees with Python's evaluation of it."""
    grid = np.arange(181) / 60.0
    lid = Curve.through([0, 1.0, 1.1, 1.3, 3.0], [0, 0, 1, 0, 0], "flat")
    take = Take("blink", grid, ("eyeBlinkLeft",), lid.evaluate(grid)[:, None])
    library = Library.of([Shot("s", {"a": Curve.through([0, 1, 2], [0, 1, 0], "flat")})])
    rig = Rig.of(take)
    result = match(take, library, rig, MatchSettings(learned=False))
    report = take_report(result, rig, library, baselines=False)
    assert "blink" in [event.kind for event in report.events]
    write_report(tmp_path / "r.html", report)
    page = browser.new_page()
    page.goto((tmp_path / "r.html").as_uri())

    def open_lids() -> list[float]:
        sized = "all => all.map(e => Number(e.getAttribute('ry')))"
        return page.eval_on_selector_all("#scene ellipse.white", sized)[1::2]

    assert open_lids() == pytest.approx([11.0, 11.0], abs=0.3)
    page.get_by_role("button", name="blink 1").click()
    assert max(open_lids()) < 1.5
    page.evaluate("faceReport.face.set(1.2)")
    here = result.channels["eyeBlinkLeft"].curve.evaluate([1.2])[0]
    assert open_lids()[1] == pytest.approx(11 * (1 - here), abs=0.01)
    page.close()
