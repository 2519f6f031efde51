"""Clips that MuJoCo itself simulates, and what the validator says about them.

Whatever a forward simulation does is possible: an error of the dynamics about such a clip is an
error of the judge. See ``python -m benchmarks.simulations --help``.
"""
