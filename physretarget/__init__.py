"""physretarget: human motion capture to non-humanoid characters, judged by physics."""

from __future__ import annotations

__version__ = "0.1.0"
