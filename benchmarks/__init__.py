"""Benchmarks: `python -m benchmarks` runs them side by side; each also runs alone.

One core, unless the environment says otherwise: set before NumPy is loaded.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
