"""``python -m physretarget``: the program, where its script is not on the path."""

from __future__ import annotations

from physretarget.cli import main

main()
