"""Public names of a package that are imported when first asked for.

Solvers, MuJoCo and drawing take a second that ``physretarget --help`` need not spend.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def attribute_getter(package: str, where: Mapping[str, tuple[str, str]]) -> Callable[[str], Any]:
    """Make a package's ``__getattr__``.

    Args:
        package: Name of the package.
        where: Public name → (module below the package, name in it).

    Returns:
        What looks a public name up, and raises AttributeError for others.
    """

    def get(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, attribute = where[name]
        return getattr(import_module(f"{package}.{module}"), attribute)

    return get
