"""Faults of known size, planted into clean clips: the smallest that the validator finds.

See ``python -m benchmarks.planted_faults --help``.
"""
