"""The report's files: nothing from a network, nothing inlined twice, hostile names harmless."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from physretarget.cli import app
from physretarget.suite.clip_page import sparkline

Library = Any  # of conftest.py, which importlib mode gives no name
HOSTILE = "<img src=x onerror=alert(1)>\"&'.npz"


def suite(*arguments: str) -> int:
    return CliRunner().invoke(app, ["suite", *arguments, "--quiet"]).exit_code


@pytest.fixture
def site(library: Library) -> Path:
    library.path("b").rename(library.folder / "clips" / HOSTILE)
    assert suite("run", str(library.file), "--workers", "1") == 0
    return library.folder / "night-report"


def test_exit_codes(library: Library) -> None:
    from physretarget.errors import PhysretargetError

    file = str(library.file)
    assert suite("run", file, "--workers", "1") == 0
    assert suite("accept", file, "--note", "start") == 0
    library.path("a").unlink()
    assert suite("run", file, "--workers", "1") == 1
    assert suite("report", file) == 1
    assert suite("report", file, "--run", "1") == 0
    assert suite("accept", file, "--clip", "*/a.npz") == 0
    assert suite("run", file, "--workers", "1") == 0
    library.file.write_text("[suite]\nfoo = 1\n")
    result = CliRunner().invoke(app, ["suite", "run", file])
    assert isinstance(result.exception, PhysretargetError)
    assert result.exception.exit_code == 2


def test_an_empty_chart_says_why(library: Library) -> None:
    def index() -> str:
        assert suite("run", str(library.file), "--workers", "1") == 0
        return (library.folder / "night-report" / "index.html").read_text()

    first = index()
    assert "<svg" not in first
    assert "No clip has an accepted baseline" in first
    assert suite("accept", str(library.file), "--note", "start") == 0
    second = index()
    assert "<svg" not in second
    assert "Nothing changed" in second


def test_everything_that_pages_name_is_there(site: Path) -> None:
    class Links(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.found: list[str] = []

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.found += [v for k, v in attrs if k in ("src", "href") and v]

    pages = [site / "index.html", *(site / "clips").iterdir()]
    assert len(pages) == 5
    for page in pages:
        links = Links()
        links.feed(page.read_text())
        for link in links.found:
            assert not link.startswith(("http:", "https:", "//")), link
            if not link.startswith("#"):
                assert (page.parent / link).is_file(), link


def test_hostile_names_are_text(site: Path) -> None:
    for page in [site / "index.html", *(site / "clips").iterdir()]:
        assert "<img" not in page.read_text()
    assert json.loads((site / "data.json").read_text())
    assert "<img" not in (site / "junit.xml").read_text()


def test_models_and_scripts_stand_once(site: Path) -> None:
    assert len(list((site / "models").iterdir())) == 1
    assert len(list((site / "motion").iterdir())) == 4
    for page in (site / "clips").iterdir():
        assert page.stat().st_size < 60_000


def test_an_unchanged_site_is_left_alone(library: Library, site: Path) -> None:
    def moments() -> dict[str, int]:
        kept = [*(site / "motion").iterdir(), *(site / "assets").iterdir()]
        kept += (site / "clips").iterdir()
        return {str(path): path.stat().st_mtime_ns for path in kept}

    before = moments()
    assert suite("report", str(library.file)) == 0
    assert moments() == before


def test_what_is_no_longer_needed_goes_and_nothing_else(library: Library, site: Path) -> None:
    own = site / "clips" / "mine.txt"
    own.write_text("kept")
    library.path("c").unlink()
    assert suite("run", str(library.file), "--workers", "1") == 0
    names = [path.name for path in (site / "clips").iterdir()]
    assert not any("c.npz" in name for name in names)
    assert own.is_file()
    assert len(list((site / "motion").iterdir())) == 3


def test_an_edited_list_of_files_removes_nothing_outside(library: Library, site: Path) -> None:
    outside = library.folder / "precious.txt"
    outside.write_text("kept")
    listed = json.loads((site / "files.json").read_text())
    (site / "files.json").write_text(json.dumps(listed | {"../precious.txt": "1"}))
    assert suite("report", str(library.file)) == 0
    assert outside.is_file()


def test_motions_are_scripts_that_hand_over_json(site: Path) -> None:
    for path in (site / "motion").iterdir():
        found = re.fullmatch(
            r'physretargetData\("motion", "([0-9a-f]{64})", (.*)\);\n', path.read_text()
        )
        assert found is not None
        assert found[1] == path.stem
        content = json.loads(found[2])
        assert (site / "models" / f"{content['model']}.js").is_file()


def test_sparklines_only_where_something_changed() -> None:
    assert sparkline([1.0, 1.0]) == ""
    assert sparkline([None, 1.0]) == ""
    assert "polyline" in sparkline([1.0, None, 2.0])
