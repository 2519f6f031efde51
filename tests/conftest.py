from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


def _data_folder() -> Path | None:
    told = os.environ.get("PHYSRETARGET_DATA")
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    folder = Path(told) if told else beside
    return folder.resolve() if folder.is_dir() else None


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real captures, or a skip that says where it is looked for."""
    folder = _data_folder()
    if folder is None:
        pytest.skip("no real captures: set PHYSRETARGET_DATA or put them in ../shared/data")
    return folder


@pytest.fixture(scope="session")
def motions() -> Path:
    """The folder of the demo's captures, or a skip that names the extra they come with."""
    # Most of the package comes along, which most tests do without.
    from physretarget.demo import motions_folder
    from physretarget.errors import MissingExtraError

    try:
        return motions_folder()
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, or a skip that says what is missing."""
    sync_api = pytest.importorskip("playwright.sync_api")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no chromium on this machine")
    arguments = (
        "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        "--no-first-run",
    )  # fmt: skip
    with sync_api.sync_playwright() as run:
        made = run.chromium.launch(executable_path=found, args=list(arguments))
        yield made
        made.close()
