"""Matching by symbols: SAX of Lin, Keogh, Lonardi, Chiu (2003), the paper's second approach.

A window is z-normalised, averaged to ``word`` pieces (PAA) and each piece named by the
equiprobable part of the normal distribution that it falls in. MINDIST between two words is a
lower bound of the Euclidean distance between the z-normalised windows.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from physretarget.errors import UsageError

Array = NDArray[np.float64]
Words = NDArray[np.int8]
ALPHABETS = range(3, 11)
_FLAT = 1e-9


@lru_cache
def breakpoints(alphabet: int) -> Array:
    """(alphabet - 1,) cuts of the normal distribution into equiprobable parts."""
    if alphabet not in ALPHABETS:
        raise UsageError(f"an alphabet of {alphabet} symbols; 3 to 10 are allowed.")
    cuts: Array = ndtri(np.arange(1, alphabet) / alphabet)
    cuts.setflags(write=False)
    return cuts


@lru_cache
def cell_distances(alphabet: int) -> Array:
    """(alphabet, alphabet): 0 for equal or neighbouring symbols, else the gap between them."""
    cuts = breakpoints(alphabet)
    row, column = np.meshgrid(np.arange(alphabet), np.arange(alphabet), indexing="ij")
    high, low = np.maximum(row, column), np.minimum(row, column)
    gap = cuts[np.clip(high - 1, 0, None)] - cuts[np.minimum(low, alphabet - 2)]
    table: Array = np.where(high - low <= 1, 0.0, gap)
    table.setflags(write=False)
    return table


def z_normalise(rows: Array) -> Array:
    """Each row to mean 0 and standard deviation 1; constant rows to zeros."""
    centred = rows - rows.mean(axis=-1, keepdims=True)
    spread = centred.std(axis=-1, keepdims=True)
    scale = np.abs(rows).max(axis=-1, keepdims=True, initial=0.0)
    flat = spread <= _FLAT * np.maximum(scale, 1e-300)
    result: Array = np.where(flat, 0.0, centred / np.where(flat, 1.0, spread))
    return result


@lru_cache(maxsize=512)
def _paa_weights(n: int, word: int) -> Array:
    """(n, word): share of every sample in every piece; samples on a border are divided."""
    edges = np.arange(n + 1)[:, None] * word / n
    piece = np.arange(word)[None, :]
    covered = np.clip(edges - piece, 0.0, 1.0)
    weights: Array = np.diff(covered, axis=0)
    return weights


def paa(rows: Array, word: int) -> Array:
    """Piecewise means of (..., n) as (..., word), also where word does not divide n."""
    if word < 1:
        raise UsageError("a word needs at least one symbol.")
    means: Array = rows @ _paa_weights(rows.shape[-1], word)
    return means


def words(rows: Array, word: int, alphabet: int) -> Words:
    """SAX words of (..., n) windows as (..., word) symbols from 0; constant: middle symbol."""
    means = paa(z_normalise(np.asarray(rows, dtype=np.float64)), word)
    return np.searchsorted(breakpoints(alphabet), means).astype(np.int8)


def mindist(one: Words, other: Words, samples: int, alphabet: int) -> Array:
    """(A, B) MINDIST of words (A, w) and (B, w) of windows of so many samples."""
    squared = squared_gaps(one, other, alphabet).astype(np.float64)
    # Rounding must not lift the bound above what it bounds.
    total: Array = np.sqrt(squared * (samples / one.shape[-1])) * (1.0 - 1e-6)
    return total


def squared_gaps(one: Words, other: Words, alphabet: int) -> NDArray[np.float32]:
    """(A, B) sums over symbols of squared cell distances, of words (A, w) and (B, w)."""
    table = (cell_distances(alphabet) ** 2).astype(np.float32)  # single precision halves the time
    # One row per symbol and place turns the double lookup into one matrix product.
    known = table[other.astype(np.intp)].reshape(len(other), -1)
    chosen = np.eye(alphabet, dtype=np.float32)[one.astype(np.intp)].reshape(len(one), -1)
    product: NDArray[np.float32] = chosen @ known.T
    return product
