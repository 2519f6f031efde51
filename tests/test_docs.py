"""The docs name what exists: links, anchors, modules, commands and their options."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer

from physretarget.cli import COMMANDS, app

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
TEXTS = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "models" / "README.md", *PAGES,
    *sorted((DOCS / "measured").glob("*.md")),
]  # fmt: skip
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
WORDS = 25_000


def anchors(path: Path) -> set[str]:
    """Ids that Markdown renderers give the headings of a page."""
    text = CODE.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", title.lower()).strip()) for title in titles}


def program() -> Any:
    """The whole command line, with every command imported."""
    group: Any = typer.main.get_command(app)
    for name in COMMANDS:
        group.load(name)
    return group


def ids(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_there_are_twelve_pages_that_can_be_read() -> None:
    assert len(PAGES) <= 12
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in PAGES) < WORDS
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 120


@pytest.mark.parametrize("path", TEXTS, ids=ids)
def test_links_lead_somewhere(path: Path) -> None:
    text = CODE.sub("", path.read_text(encoding="utf-8"))
    for link in LINK.findall(text):
        if "://" in link:
            continue
        target, _, anchor = link.partition("#")
        file = (path.parent / target).resolve() if target else path
        assert file.exists(), f"{path.name}: {link}"
        if anchor:
            assert anchor in anchors(file), f"{path.name}: {link}"


def test_every_measured_page_and_picture_is_linked() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in TEXTS)
    for path in [*DOCS.glob("measured/*.md"), *DOCS.rglob("*.png")]:
        assert f"{path.parent.name}/{path.name}" in text, path.name


@pytest.mark.parametrize("path", sorted((DOCS / "measured").glob("*.md")), ids=ids)
def test_a_measured_page_names_its_command(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert re.search(r"python -m \w+|python (?:tests|benchmarks)/\w+|physretarget reproduce", text)
    for module in re.findall(r"-m (benchmarks\.\w+)", text):
        assert list((ROOT / "benchmarks").glob(f"{module.split('.')[1]}*")), module


def test_links_from_the_code_lead_somewhere() -> None:
    folders = ("physretarget", "tests", "benchmarks", "examples", "fuzz", "deploy", "blender")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*")]
    for path in files:
        if path.suffix in {".py", ".j2", ".md", ".html", ".js", ".toml", ".service"}:
            for page in re.findall(r"\bdocs/[\w/-]+\.md", path.read_text(encoding="utf-8")):
                assert (ROOT / page).is_file(), f"{path}: {page}"


def dotted_names() -> list[tuple[str, str]]:
    """Names in backticks that begin with the package."""
    found = set()
    for path in [ROOT / "README.md", *PAGES]:
        text = CODE.sub("", path.read_text(encoding="utf-8"))
        found |= {(path.name, name) for name in re.findall(r"`(physretarget(?:\.\w+)+)", text)}
    return sorted(found)


@pytest.mark.parametrize(("page", "name"), dotted_names())
def test_names_exist(page: str, name: str) -> None:
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            value = getattr(value, part)
        return
    raise AssertionError(f"{page}: {name}")


def test_files_exist() -> None:
    folders = "physretarget|examples|models|deploy|blender|tests|benchmarks"
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]:
        text = path.read_text(encoding="utf-8")
        for name in re.findall(rf"`((?:{folders})/[\w./-]*)`", text):
            schema = re.fullmatch(r"physretarget/\w+/\d", name)
            assert schema or (ROOT / name).exists(), f"{path.name}: {name}"


def invocations() -> list[tuple[str, str]]:
    """Commands of this program that the docs show: in blocks, and in backticks."""
    found = []
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "models/README.md", *PAGES]:
        text = path.read_text(encoding="utf-8")
        blocks = [body for kind, body in CODE.findall(text) if kind == "sh"]
        lines = [line for body in blocks for line in body.replace("\\\n", " ").splitlines()]
        spans = re.findall(r"`(physretarget [^`]+)`", CODE.sub("", text))
        for line in [*lines, *(" ".join(span.split()) for span in spans)]:
            if line.startswith("physretarget "):
                found.append((path.name, line))
    return found


@pytest.mark.parametrize(("page", "line"), invocations())
def test_commands_and_options_exist(page: str, line: str) -> None:
    words = shlex.split(line.split("  #")[0])[1:]
    command = program()
    while words and hasattr(command, "commands"):
        if words[0].startswith("-"):
            return
        assert words[0] in command.commands, f"{page}: {line}"
        command = command.commands[words.pop(0)]
    known = {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
    for word in words:
        if word.startswith("-") and not word[1:2].isdigit():
            assert word.split("=")[0] in known | {"--help"}, f"{page}: {word}"


def all_options() -> set[str]:
    known = {"--help", "--version", "--install-completion"}
    pending = [program()]
    while pending:
        command = pending.pop()
        pending += getattr(command, "commands", {}).values()
        known |= {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
    return known


def test_options_named_in_text_exist() -> None:
    known = all_options()
    for path in [ROOT / "README.md", *PAGES]:
        text = CODE.sub("", path.read_text(encoding="utf-8"))
        for span in re.findall(r"`(--[^`]+)`", text):
            if span.startswith(("--cap-drop", "--head")):
                continue  # of other programs
            for word in re.findall(r"(?<!\S)--[a-z-]+", span):
                assert word in known, f"{path.name}: {word}"


def attributes() -> list[tuple[str, str]]:
    """`Class.attribute` in the glossary's table of symbols."""
    table = (DOCS / "glossary.md").read_text(encoding="utf-8").split("## On paper")[1]
    return re.findall(r"`([A-Z]\w+)\.(\w+)`", table)


@pytest.mark.parametrize(("owner", "name"), attributes())
def test_symbols_of_the_glossary_are_in_the_code(owner: str, name: str) -> None:
    for path in (ROOT / "physretarget").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for body in re.findall(rf"^class {owner}\b.*?(?=^[^\s)#]|\Z)", text, re.M | re.S):
            if re.search(rf"\b{name}\b(\(|:| =)", body):
                return
    raise AssertionError(f"{owner}.{name}")
