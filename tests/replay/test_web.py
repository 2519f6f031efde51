from __future__ import annotations

import re
import threading
import urllib.error
import urllib.request

import pytest

from physretarget import assets
from physretarget.errors import InputError, UsageError
from physretarget.replay.web import asset, render, server, write_html


def test_the_page_loads_nothing(scene) -> None:
    page = render(scene)
    assert not re.search(r"<(?:script|link|img|iframe)[^>]*\b(?:src|href)=", page)
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_hostile_names_stay_text(scene) -> None:
    page = render(scene)
    assert "alert(1)" in page
    assert "<script>alert(1)" not in page
    assert "<img src=x>" not in page
    assert page.count("<script") == page.count("</script>")


def test_the_verdict_stands_above_the_player_with_the_clips_name(scene) -> None:
    page = render(scene, title="<b>walk</b>", verdict="not plausible, 2 errors", outcome="failed")
    head = page.split("<header>")[1].split("</header>")[0]
    assert "<h1>&lt;b&gt;walk&lt;/b&gt;</h1>" in head
    assert '<p class="failed">not plausible, 2 errors</p>' in head
    assert "<header>" not in render(scene)


def test_no_script_can_end_early() -> None:
    for name in ("three.min.js", "clock.js", "stage.js", "player.js", "filmstrip.js"):
        assert "</script" not in asset(name).lower()
        assert "<!--" not in asset(name)


def test_same_scene_same_bytes(scene, tmp_path) -> None:
    a, b = write_html(scene, tmp_path / "a.html"), write_html(scene, tmp_path / "b.html")
    assert a.read_bytes() == b.read_bytes()
    assert a.stat().st_size < 1_000_000
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "b.html"]


def test_an_unwritable_place_is_one_sentence(scene, tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_html(scene, tmp_path / "file" / "a.html")


def test_the_server_gives_the_page_on_loopback_alone() -> None:
    with server("<p>hello</p>") as running:
        host, port = running.server_address[:2]
        assert host == "127.0.0.1"
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as answer:
            assert answer.read() == b"<p>hello</p>"
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://127.0.0.1:{port}/../etc/passwd")
        with pytest.raises(UsageError, match="cannot listen"):
            server("", port=port)
        running.shutdown()


def test_a_port_out_of_range_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="99999"):
        server("", port=99999)


def test_licences_travel_with_the_libraries() -> None:
    assert "MIT" in asset("LICENSE.three")
    assert "MIT" in assets.text("LICENSE.uplot")
