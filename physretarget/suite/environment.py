"""The site's templates; they escape everything, for names may be hostile."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined


@cache
def templates() -> Environment:
    """The environment they are rendered in."""
    made = Environment(
        loader=PackageLoader("physretarget.suite", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # The order of charts is ours, not the alphabet's.
    made.policies["json.dumps_kwargs"] = {"sort_keys": False, "allow_nan": False}
    return made


@cache
def source(name: str) -> str:
    """The text of a template."""
    environment = templates()
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]
