"""The papers' figures and tables again, from real captures, in one run."""

from __future__ import annotations

from physretarget.reproduce.yamane import reproduce_yamane2010

__all__ = ["reproduce_yamane2010"]
