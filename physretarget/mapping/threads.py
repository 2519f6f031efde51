"""One BLAS thread for small matrices.

Matrices of a few dozen rows get up to twenty times slower when BLAS spreads them over threads,
and sums taken in a varying order would cost the same-bytes promise.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

P = ParamSpec("P")
R = TypeVar("R")


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    return ThreadpoolController()  # scans the loaded libraries once: 1 ms


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: run ``function`` with BLAS pinned to one thread."""

    @wraps(function)
    def pinned(*args: P.args, **kwargs: P.kwargs) -> R:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return pinned
