"""The web page in Chromium: with the keyboard alone, on a phone, with hostile names."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")

from playwright.sync_api import Browser, Page, expect  # noqa: E402

from physretarget.clip import Clip  # noqa: E402
from physretarget.service.pages import WEB  # noqa: E402
from physretarget.service.tokens import hashed, make_token  # noqa: E402

_SLOW = 60_000
_PHONE, _DESK = (390, 844), (1280, 800)
_EXAMPLES = WEB / "examples"
_AUDIT = Path(__file__).with_name("audit.js").read_text()
_NASTY = "<img src=x onerror=window.hacked=1>"


@pytest.fixture(scope="module")
def web(start: Callable[..., Any]) -> Any:
    """A service of this file's own: what is in it is known."""
    return start(workers=1)


@contextmanager
def _opened(
    browser: Browser, url: str, place: str = "", size: tuple[int, int] = _DESK, **more: Any
) -> Iterator[Page]:
    """A page in a context of its own; whatever the console or the network tells is a failure."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, accept_downloads=True, **more
    )
    page = context.new_page()
    told: list[str] = []
    page.on("pageerror", lambda error: told.append(f"error: {error}"))
    page.on(
        "console",
        lambda message: (
            told.append(message.text)
            if message.type == "error" and "Failed to load resource" not in message.text
            else None
        ),
    )
    page.on(
        "request",
        lambda request: (
            None
            if request.url.startswith((url, "data:", "blob:", "about:"))
            else told.append(f"left the server: {request.url}")
        ),
    )
    # Choosers are caught for as long as somebody listens. Who starts to listen with the press
    # itself may come too late: the browser then opens a dialog that nobody ever closes.
    page.on("filechooser", lambda chooser: None)
    page.set_default_timeout(20_000)
    page.goto(f"{url}/{place}")
    yield page
    context.close()
    assert told == []


@pytest.fixture(scope="module")
def judged(web: Any) -> list[str]:
    """Ids of finished jobs: the example that passes, the careless one, one that was not judged."""
    ids = []
    for name in ("lamp-look.npz", "lamp-look-careless.npz"):
        content = (_EXAMPLES / name).read_bytes()
        web.client.post("/api/v1/clips", files={"file": (name, content)}).raise_for_status()
        answer = web.client.post(
            "/api/v1/jobs", data={"model": "lamp"}, files={"clip": (name, content)}
        )
        assert answer.status_code == 202, answer.text
        ids.append(answer.json()["id"])
    wrong = web.client.post(
        "/api/v1/jobs", data={"model": "penguin"},
        files={"clip": ("lamp.npz", (_EXAMPLES / "lamp-look.npz").read_bytes())},
    )  # fmt: skip
    assert wrong.status_code == 202, wrong.text
    ids.append(wrong.json()["id"])
    for id in ids:
        web.wait(id)
    return ids


def _audit(page: Page, what: str) -> Any:
    return page.evaluate(f"{_AUDIT.strip()}.{what}()")


def _tab_to(page: Page, selector: str, presses: int = 80) -> None:
    """Press Tab until the focus is there: what Tab does not reach, the keyboard cannot use."""
    for _ in range(presses):
        page.keyboard.press("Tab")
        if page.evaluate("s => document.activeElement?.matches(s) ?? false", selector):
            shown = _audit(page, "focusShown")
            assert shown, f"the focus on {selector} cannot be seen"
            return
    raise AssertionError(f"Tab does not reach {selector}")


def _choose(page: Page, file: Any) -> None:
    """Space on the focused file input opens its chooser, which takes ``file``."""
    with page.expect_file_chooser(timeout=_SLOW) as chooser:
        page.keyboard.press("Space")
    chooser.value.set_files(file)


def _long_clip(frames: int = 60_000) -> dict[str, Any]:
    """A lamp that looks around for long: its job takes seconds."""
    with np.load(_EXAMPLES / "lamp-look.npz") as known:
        qpos, names = known["qpos"], tuple(str(n) for n in known["joint_names"])
    many = np.resize(qpos, (frames, qpos.shape[1]))
    clip = Clip(qpos=many, time=np.arange(frames) / 60.0, joint_names=names)
    return {
        "name": "long.npz",
        "mimeType": "application/octet-stream",
        "buffer": clip.to_bytes(),
    }


# ---- the way through ---------------------------------------------------------------------------


def _through(page: Page, clip: Any, model: Any) -> None:
    """Submit with the keyboard alone, up to the report."""
    _tab_to(page, "#nav a[href='#/new']")
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("Submit")
    _tab_to(page, "input[name=clip]")
    _choose(page, clip)
    _tab_to(page, "input[type=radio][name=model]")
    page.keyboard.press("ArrowUp")  # from the first round to the last: upload
    _tab_to(page, "input[type=file][name=model]")
    _choose(page, model)
    _tab_to(page, "select[name=option-profile]")
    page.keyboard.press("r")
    _tab_to(page, "button[type=submit]")
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile(r"#/jobs/[0-9a-z]{26}$"), timeout=_SLOW)
    expect(page.locator(".chip.passed, .chip.unfit")).to_be_visible(timeout=_SLOW)
    _tab_to(page, "a[href$='view=report']")
    page.keyboard.press("Enter")
    report = page.frame_locator("iframe")
    expect(report.get_by_role("heading", level=1)).to_be_visible(timeout=_SLOW)
    expect(report.get_by_role("heading", name="Coverage")).to_be_attached()


def test_a_robot_clip_by_keyboard_alone(browser: Browser, web: Any, data: Path) -> None:
    robot = data / "robot"
    with _opened(browser, web.url) as page:
        _through(page, robot / "g1_walk.csv", robot / "g1_no_mesh_box_feet.xml")
        expect(page.get_by_role("heading", level=1)).to_have_text("g1_walk.csv")
        job = web.client.get(f"/api/v1/jobs/{page.url.split('/')[-1].split('?')[0]}").json()
    assert job["options"] == {"profile": "robot", "fps": 30.0}


def test_a_box_by_keyboard_alone(
    browser: Browser, web: Any, clip: Callable[..., bytes], tmp_path: Path
) -> None:
    model = web.client.get("/api/v1/models").json()
    assert model["items"]
    place = tmp_path / "box.npz"
    place.write_bytes(clip(0.0))
    xml = tmp_path / "box.xml"
    xml.write_text(_box())
    with _opened(browser, web.url) as page:
        _through(page, place, xml)


def _box() -> str:
    return """<mujoco model="box"><worldbody><geom type="plane" size="5 5 1"/>
    <body name="box" pos="0 0 .1"><freejoint name="root"/><geom type="box" size=".1 .1 .1"/></body>
    </worldbody></mujoco>"""


def test_who_leaves_before_the_report_came_is_told_nothing(browser: Browser, web: Any) -> None:
    """What is under way is given up, and that is no error of the page's."""
    with _opened(browser, web.url, "#/new") as page:
        page.route("**/report?format=json", lambda route: None)  # never answered
        page.get_by_role("button", name="a look around", exact=True).click()
        expect(page.locator(".go dd", has_text="lamp-look.npz")).to_be_visible()
        page.get_by_role("button", name="Judge it").click()
        expect(page.locator("a[href$='view=report']")).to_be_visible(timeout=_SLOW)
        page.goto(f"{web.url}/#/library")
        expect(page.get_by_role("heading", level=1)).to_have_text("Library")


def test_the_skip_link_and_focus_order(browser: Browser, web: Any, judged: list[str]) -> None:
    with _opened(browser, web.url, "#/jobs") as page:
        expect(page.locator(".job").first).to_be_visible()
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.id") == "skip"
        page.keyboard.press("Enter")
        assert page.evaluate("document.activeElement.id") == "main"
        assert page.url.endswith("#/jobs")


def test_progress_is_seen_and_a_job_cancelled(browser: Browser, web: Any) -> None:
    with _opened(browser, web.url, "#/new") as page:
        page.locator("input[name=clip]").set_input_files(_long_clip())
        page.get_by_label("lamp").check(force=True)
        page.get_by_role("button", name="Judge it").click()
        bar = page.get_by_role("progressbar", name="Progress of long.npz")
        expect(bar).to_be_visible(timeout=_SLOW)
        expect(page.locator(".share")).to_have_text(re.compile(r"[1-9]\d* %"), timeout=_SLOW)
        assert float(bar.get_attribute("value") or bar.evaluate("b => b.value")) <= 1
        assert page.locator("#live").inner_text()
        page.goto(f"{web.url}/#/jobs")
        expect(page.locator(".job progress")).to_be_visible()
        page.get_by_role("button", name="Cancel long.npz").click()
        expect(page.locator(".job", has_text="long.npz").locator(".chip.cancelled")).to_be_visible(
            timeout=_SLOW
        )


def test_without_streams_the_page_asks_again(browser: Browser, web: Any) -> None:
    with _opened(browser, web.url, "#/new") as page:
        page.route("**/events", lambda route: route.abort())
        page.locator("input[name=clip]").set_input_files(_long_clip(2000))
        page.get_by_label("lamp").check(force=True)
        page.get_by_role("button", name="Judge it").click()
        expect(page.locator(".chip.passed, .chip.unfit")).to_be_visible(timeout=_SLOW)


def test_the_example_of_an_empty_service(browser: Browser, start: Callable[..., Any]) -> None:
    fresh = start(workers=1)
    with _opened(browser, fresh.url) as page:
        page.get_by_role("button", name="Try the example").click()
        expect(page.get_by_role("heading", level=1)).to_have_text("lamp-jump.npz")
        expect(page.locator(".findings li").first).to_be_visible(timeout=_SLOW)
        replay = page.frame_locator("iframe")
        expect(replay.locator(".pr-clock")).to_be_visible(timeout=_SLOW)
        when = page.locator("button.at").first
        seconds = float(when.inner_text().split()[0])
        when.click()
        expect(replay.locator(".pr-clock")).to_contain_text(f"{seconds:.2f} s")
        expect(replay.locator("[aria-label^=Play], [title^=Play]").first).to_be_visible()
        with page.expect_download() as got:
            page.get_by_role("link", name="SARIF").click()
        assert got.value.suggested_filename == "lamp-jump.sarif"


# ---- compare, search, back ---------------------------------------------------------------------


def test_two_jobs_are_compared(browser: Browser, web: Any, judged: list[str]) -> None:
    with _opened(browser, web.url) as page:
        for name in ("lamp-look-careless.npz", "lamp-look.npz"):
            page.get_by_label(f"Choose {name} to compare").first.check()
        page.get_by_role("link", name="Compare them").click()
        expect(page).to_have_url(re.compile(f"left={judged[1]}&right={judged[0]}"))
        expect(page.locator(".verdict-line .chip")).to_have_text("fixed")
        rows = page.locator("table.measures tbody tr")
        changed = rows.count()
        assert changed > 0
        assert page.locator("tr.better").count() > page.locator("tr.worse").count()
        page.get_by_label("only what changed").uncheck()
        assert rows.count() > changed
        expect(page.locator("tr", has_text="CON002").locator(".chip")).to_have_text("fixed")
        both = page.frame_locator("iframe")
        expect(both.locator(".pr-tag")).to_have_count(2, timeout=_SLOW)
        page.get_by_role("button", name="Swap left and right").click()
        expect(page.locator(".verdict-line .chip")).to_have_text("worse")
        page.reload()
        expect(page.locator(".verdict-line .chip")).to_have_text("worse")


def test_search_back_and_reload(browser: Browser, web: Any, judged: list[str]) -> None:
    with _opened(browser, web.url) as page:
        page.get_by_role("searchbox").fill("careless")
        expect(page.locator(".job")).to_have_count(1)
        assert page.url.endswith("#/jobs?q=careless")
        page.locator(".job a.name").click()
        expect(page.get_by_role("heading", level=1)).to_have_text("lamp-look-careless.npz")
        page.get_by_role("link", name="Full report").click()
        expect(page).to_have_url(re.compile("view=report"))
        page.go_back()
        expect(page.locator(".findings")).to_be_visible()
        page.go_back()
        expect(page.get_by_role("searchbox")).to_have_value("careless")
        expect(page.locator(".job")).to_have_count(1)
        page.reload()
        expect(page.get_by_role("searchbox")).to_have_value("careless")
        page.get_by_role("searchbox").fill("no such thing")
        expect(page.get_by_text("No job is like that")).to_be_visible()


def test_judge_again_keeps_what_was_told(browser: Browser, web: Any, judged: list[str]) -> None:
    with _opened(browser, web.url, f"#/new?from={judged[0]}") as page:
        expect(page.get_by_role("heading", level=1)).to_contain_text("lamp-look.npz")
        expect(page.get_by_label("or one sent before").locator("option:checked")).to_contain_text(
            "lamp-look.npz"
        )
        page.get_by_label("Low-pass, Hz").fill("6")
        page.get_by_role("button", name="Judge it").click()
        expect(page.locator(".chip.passed")).to_be_visible(timeout=_SLOW)
        job = web.client.get(f"/api/v1/jobs/{page.url.split('/')[-1]}").json()
    assert job["options"] == {"lowpass": 6.0}
    assert job["model"]["id"] == "lamp"


# ---- what goes wrong ---------------------------------------------------------------------------


def test_a_broken_file_is_told_beside_it(browser: Browser, web: Any) -> None:
    with _opened(browser, web.url, "#/new") as page:
        page.get_by_role("button", name="Judge it").click()
        alert = page.locator("[data-place=clip] [role=alert]")
        expect(alert).to_have_text("Choose a clip first.")
        page.locator("input[name=clip]").set_input_files(
            {"name": "broken.npz", "mimeType": "application/zip", "buffer": b"PK not really"}
        )
        page.get_by_label("lamp").check(force=True)
        page.get_by_role("button", name="Judge it").click()
        told = page.locator("[role=alert]", has_text=re.compile("npz|zip|read|clip", re.I))
        expect(told.first).to_be_visible(timeout=_SLOW)
        field = page.locator("[data-place=clip] [aria-invalid=true]")
        expect(field).to_be_focused()
        assert told.first.get_attribute("id") in (field.get_attribute("aria-describedby") or "")


def test_a_hostile_zip_is_told_beside_the_model(browser: Browser, web: Any) -> None:
    bomb = io.BytesIO()
    with zipfile.ZipFile(bomb, "w") as archive:
        archive.writestr("../../etc/passwd", "x")
    with _opened(browser, web.url, "#/new?model=upload") as page:
        page.get_by_role("button", name="a jump", exact=True).click()
        expect(page.locator(".go dd", has_text="lamp-jump.npz")).to_be_visible()
        page.get_by_label("Upload xml or zip").check(force=True)  # the example brings its own
        page.locator("input[type=file][name=model]").set_input_files(
            {"name": "bad.zip", "mimeType": "application/zip", "buffer": bomb.getvalue()}
        )
        page.get_by_role("button", name="Judge it").click()
        alert = page.locator("[data-place=model] [role=alert]")
        expect(alert).to_be_visible(timeout=_SLOW)
        assert len(alert.inner_text()) > 10


def test_an_option_out_of_bounds_is_told_beside_it(browser: Browser, web: Any) -> None:
    with _opened(browser, web.url, "#/new") as page:
        page.get_by_role("button", name="a jump", exact=True).click()
        page.get_by_text("More options").click()
        page.get_by_label("Ignore findings").fill("XYZ999")
        expect(page.locator(".go dd", has_text="lamp-jump.npz")).to_be_visible()
        page.get_by_role("button", name="Judge it").click()
        expect(page.locator("[data-place=options] [role=alert]").first).to_contain_text("XYZ999")


def test_a_server_that_is_gone_is_told(browser: Browser, web: Any, judged: list[str]) -> None:
    with _opened(browser, web.url, "#/jobs") as page:
        expect(page.locator(".job").first).to_be_visible()
        page.route("**/api/**", lambda route: route.abort())
        page.route("**/health", lambda route: route.abort())
        page.locator("#nav a[href='#/library']").click()
        expect(page.locator("[role=alert]")).to_contain_text("out of reach")
        page.unroute("**/api/**")
        page.get_by_role("button", name="Try again").click()
        expect(page.locator(".model").first).to_be_visible()
        page.goto(f"{web.url}/#/jobs/{'0' * 26}")
        expect(page.locator("[role=alert]")).to_contain_text("no such thing")
        page.goto(f"{web.url}/#/nonsense")
        expect(page.get_by_role("heading", level=1)).to_have_text("There is nothing here")


def test_hostile_names_stay_text(browser: Browser, web: Any) -> None:
    content = (_EXAMPLES / "lamp-look-careless.npz").read_bytes()
    with _opened(browser, web.url, "#/new") as page:
        page.locator("input[name=clip]").set_input_files(
            {"name": f"{_NASTY}.npz", "mimeType": "application/zip", "buffer": content}
        )
        page.get_by_label("lamp").check(force=True)
        page.get_by_role("button", name="Judge it").click()
        expect(page.locator(".chip.unfit")).to_be_visible(timeout=_SLOW)
        expect(page.get_by_role("heading", level=1)).to_contain_text("<img src=x")
        id = page.url.split("/")[-1]
        made = web.client.post(
            "/api/v1/models", data={"name": _NASTY}, files={"file": ("box.xml", _box().encode())}
        )
        assert made.status_code == 201, made.text
        other = web.client.get("/api/v1/jobs?status=done&limit=5").json()["items"][-1]["id"]
        for place in (
            f"#/jobs/{id}?view=report", "#/jobs", "#/library", "#/new", f"#/new?from={id}",
            "#/compare", f"#/compare?left={id}&right={other}",
        ):  # fmt: skip
            page.goto("about:blank")  # so that no frame of the place before is met while it goes
            page.goto(f"{web.url}/{place}")
            page.wait_for_load_state("networkidle")
            for frame in page.frames:
                assert frame.evaluate("typeof window.hacked") == "undefined", place
                assert frame.locator("img[src=x]").count() == 0, place
        web.client.delete(f"/api/v1/models/{made.json()['id']}").raise_for_status()
        web.client.delete(f"/api/v1/jobs/{id}").raise_for_status()


# ---- token -------------------------------------------------------------------------------------


def test_a_token_is_asked_for_and_kept(browser: Browser, start: Callable[..., Any]) -> None:
    locked, token = start(workers=1), make_token()
    locked.service.registry.add_token("page", "submit", hashed(token))
    locked.service.tokens._until = -1.0
    with _opened(browser, locked.url) as page:
        dialog = page.get_by_role("dialog", name="A token, please")
        expect(dialog.get_by_label("Token")).to_be_focused()
        page.keyboard.press("Escape")
        expect(page.locator("[role=alert]")).to_contain_text("A token is needed")
        page.get_by_role("button", name="Enter token").click()
        page.keyboard.type("prt_wrong")
        page.keyboard.press("Enter")
        expect(dialog.locator("[role=alert]")).to_contain_text("does not know")
        page.keyboard.type(token)
        page.keyboard.press("Enter")
        expect(dialog).to_have_count(0)
        page.get_by_role("button", name="Try the example").click()
        replay = page.frame_locator("iframe")
        expect(replay.locator(".pr-clock")).to_be_visible(timeout=_SLOW)  # came with a ticket
        with page.expect_download() as got:
            page.get_by_role("link", name="JSON").click()
        assert got.value.suggested_filename == "lamp-jump.json"
        page.reload()
        expect(page.get_by_role("heading", level=1)).to_have_text("lamp-jump.npz")
        assert page.evaluate("localStorage.length") == 0
        assert token not in page.url
        page.get_by_role("button", name="Forget token").click()
        expect(dialog).to_be_visible()
        assert page.evaluate("sessionStorage.length") == 0


# ---- everybody can use it ----------------------------------------------------------------------

_PLACES = (
    "#/jobs", "#/new", "#/new?kind=retarget", "#/library", "#/compare", "#/jobs/{0}", "#/jobs/{1}",
    "#/jobs/{1}?view=report", "#/jobs/{2}", "#/compare?left={0}&right={1}",
)  # fmt: skip


def _settled(page: Page, url: str, place: str) -> None:
    page.goto(f"{url}/{place}")
    expect(page.locator("main h1")).to_be_visible()
    page.wait_for_load_state("networkidle")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_names_structure_and_contrast(
    browser: Browser, web: Any, judged: list[str], scheme: str
) -> None:
    with _opened(browser, web.url, color_scheme=scheme) as page:
        for pattern in _PLACES:
            place = pattern.format(*judged)
            _settled(page, web.url, place)
            assert _audit(page, "withoutName") == [], place
            assert _audit(page, "structure") == [], place
            assert _audit(page, "contrast") == [], place
            assert page.title().endswith("physretarget")


@pytest.mark.parametrize("size", [_PHONE, (320, 640)])
def test_a_phone_never_scrolls_sideways(
    browser: Browser, web: Any, judged: list[str], size: tuple[int, int]
) -> None:
    with _opened(browser, web.url, size=size, has_touch=True, is_mobile=True) as page:
        for pattern in _PLACES:
            place = pattern.format(*judged)
            _settled(page, web.url, place)
            wide = page.evaluate("document.documentElement.scrollWidth")
            assert wide <= size[0], f"{place}: {wide}"
        _settled(page, web.url, "#/jobs")
        small = page.evaluate(
            """() => [...document.querySelectorAll('nav a, .button')].filter(n => n.offsetParent)
            .filter(n => n.getBoundingClientRect().height < 32).map(n => n.textContent)"""
        )
        assert small == []  # nothing too small for a thumb


def test_the_sources_keep_to_the_policy() -> None:
    index = (WEB / "index.html").read_text()
    assert not re.search(r"<script(?![^>]*\bsrc=)", index)
    assert not re.search(r"<style|\sstyle=|\son[a-z]+=", index)
    for source in WEB.rglob("*.js"):
        text = source.read_text()
        assert not re.search(
            r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", text
        )
        assert "://" not in text.replace('"http://www.w3.org/2000/svg"', ""), source.name
