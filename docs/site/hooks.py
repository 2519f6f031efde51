"""What the site shows besides the pages of docs/: README, CONTRIBUTING, CHANGELOG, models, the API.

Their links are those of the repository; here they are turned to the site's pages, and links to
files that the site does not have become plain text.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

import physretarget

ROOT = Path(__file__).parents[2]
PAGES = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
    "models.md": "models/README.md",
}
ROOMS = (
    "physretarget.report",
    "physretarget.replay",
    "physretarget.stream",
    "physretarget.simulate",
    "physretarget.contact",
    "physretarget.kinetics",
    "physretarget.face",
    "physretarget.validation",
    "physretarget.capture",
    "physretarget.clip",
    "physretarget.keyposes",
    "physretarget.mapping",
    "physretarget.mjcf",
    "physretarget.studio",
    "physretarget.errors",
)
_API_HEAD = """# Python API

*Reference, from the docstrings.* The names on this page are public. Within a minor version they
keep their names, arguments and meaning; the changelog announces a removal one minor version ahead.
Names that begin with an underscore, and modules that are not listed here, may change at any time.

Arrays are NumPy's. `T` is frames; `nq`, `nv` and `nu` are MuJoCo's. World axes are z up, in metres,
seconds and kilograms; quaternions are wxyz; frames count from 0.

## physretarget
"""
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that have no file in docs/."""
    for name, source in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=_for_site(text, Path(source).parent)))
    files.append(File.generated(config, "api.md", content=_api()))
    return files


def _for_site(text: str, folder: Path) -> str:
    """The text with its relative links turned to pages of the site."""
    back = {source: name for name, source in PAGES.items()}

    def turn(found: re.Match[str]) -> str:
        picture, label, link = found.groups()
        if "://" in link or link.startswith("#"):
            return found[0]
        path, _, anchor = link.partition("#")
        inside = str((ROOT / folder / path).resolve().relative_to(ROOT))
        target = inside.removeprefix("docs/") if inside.startswith("docs/") else back.get(inside)
        if target is None:
            return f"`{label}`"
        return f"{picture}[{label}]({target}{'#' * bool(anchor)}{anchor})"

    return LINK.sub(turn, text)


def _api() -> str:
    """The page of the API: mkdocstrings replaces each line that begins with colons."""
    lines = [_API_HEAD]
    for name in physretarget.__all__:
        if name != "__version__":
            module, attribute = physretarget._WHERE[name]
            lines += [f"::: physretarget.{module}.{attribute}", ""]
    for room in ROOMS:
        lines += [f"## {room}", "", f"::: {room}", "    options:", "      show_root_heading: false"]
        lines += ["      show_root_toc_entry: false", ""]
    return "\n".join(lines)
