"""Fuzz one reader: ``python fuzz/run.py TARGET [folder of inputs] [options of libFuzzer]``.

See README.md beside this file. Needs the extra "fuzz" (atheris).
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parent))
# Whether a branch was taken is seen in the package's code only: libraries are not on trial.
with atheris.instrument_imports(include=["physretarget"]):
    from targets import TARGETS, try_input

# A fuzzer does not guess check sums: without them it gets beyond the archive.
zipfile.ZipExtFile._update_crc = lambda self, data: None  # type: ignore[attr-defined]


def main() -> None:
    """Run libFuzzer on the target named first."""
    if len(sys.argv) < 2 or sys.argv[1] not in TARGETS:
        sys.exit(f"usage: python fuzz/run.py {'|'.join(TARGETS)} [inputs] [-option=value ...]")
    target = sys.argv.pop(1)

    def once(content: bytes) -> None:
        try_input(target, content)

    atheris.Setup(sys.argv, once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
