"""The public API: every name is there, has one home, and says what it takes and gives."""

from __future__ import annotations

import ast
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]


def rooms() -> list[str]:
    """The modules whose names are public: those of the site's API page."""
    tree = ast.parse((ROOT / "docs" / "site" / "hooks.py").read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "ROOMS":
            return ["physretarget", *ast.literal_eval(node.value)]
    raise AssertionError("hooks.py has no ROOMS")


def public() -> Iterator[tuple[str, Any]]:
    """Every public function, class and method, once."""
    seen = set()
    for room in rooms():
        module = importlib.import_module(room)
        for name in module.__all__:
            value = getattr(module, name)
            if id(value) in seen or name == "__version__":
                continue
            seen.add(id(value))
            if inspect.isfunction(value):
                yield f"{room}.{name}", value
            elif inspect.isclass(value):
                yield f"{room}.{name}", value
                for key, member in vars(value).items():
                    function = getattr(member, "__func__", member)
                    if not key.startswith("_") and inspect.isfunction(function):
                        yield f"{room}.{name}.{key}", function


def faults(value: Any) -> list[str]:
    """What the docstring of a function or class lacks."""
    # Of a class its own: what dataclasses and enumerations write is no docstring.
    text = inspect.cleandoc(vars(value).get("__doc__") or "") if inspect.isclass(value) else None
    text = inspect.getdoc(value) or "" if text is None else text
    if inspect.isclass(value):
        bare = not text or text.startswith(f"{value.__name__}(")
        return ["a docstring"] if bare else []
    signature = inspect.signature(value)
    names = [name for name in signature.parameters if name not in {"self", "cls"}]
    if not names:
        return [] if text else ["a docstring"]
    lacking = [] if "Args:" in text else ["Args"]
    described = text.split("Args:")[-1]
    lacking += [name for name in names if f"{name}:" not in described]
    gives = signature.return_annotation not in {None, "None", inspect.Signature.empty}
    if gives and not any(word in text for word in ("Returns:", "Yields:")):
        lacking.append("Returns")
    return lacking


@pytest.mark.parametrize("room", rooms())
def test_a_room_says_what_is_public(room: str) -> None:
    module = importlib.import_module(room)
    assert len(set(module.__all__)) == len(module.__all__)
    assert (module.__doc__ or "").strip()
    for name in module.__all__:
        getattr(module, name)
        assert not name.startswith("_") or name == "__version__"


def test_public_names_say_what_they_take_and_give() -> None:
    lacking = {name: found for name, value in public() if (found := faults(value))}
    assert lacking == {}


def test_a_fault_is_seen() -> None:
    def bare(clip: int) -> int:
        """Nothing said."""
        return clip

    assert faults(bare) == ["Args", "clip", "Returns"]
