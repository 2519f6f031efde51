"""From actor features to character features, learned from key poses: matrix in, matrix out.

Plain NumPy and SciPy; knows no simulator and no file. :func:`fit` learns any of the mappers,
which all offer ``predict`` and ``to_arrays`` (:class:`Mapper`).
"""

from __future__ import annotations

from physretarget.errors import InputError, UsageError
from physretarget.mapping.gp import GaussianProcess, fit_gp
from physretarget.mapping.gplvm import SharedGPLVM, fit_gplvm
from physretarget.mapping.nearest import NearestPoses, fit_nearest
from physretarget.mapping.pca import PrincipalMap, fit_pca, fit_ridge
from physretarget.mapping.protocol import Array, Arrays, Mapped, Mapper, Space
from physretarget.options.retargeting import MAPPERS as NAMES
from physretarget.options.retargeting import MapperOptions

__all__ = [
    "NAMES",
    "GaussianProcess",
    "Mapped",
    "Mapper",
    "NearestPoses",
    "PrincipalMap",
    "SharedGPLVM",
    "Space",
    "fit",
    "from_arrays",
]

DEFAULT_ITERATIONS = 70


def fit(
    name: str,
    y: Array,
    z: Array,
    *,
    dims: int = MapperOptions.dims,
    iterations: int = DEFAULT_ITERATIONS,
    seed: int = 0,
    calibrated: bool = True,
) -> Mapper:
    """Learn mapper ``name`` from key poses y (N, DY), z (N, DZ), N ≥ 2.

    ``dims`` concerns ``sgplvm`` (latent dimensions) and ``pca``; ``iterations`` and ``seed``
    concern ``sgplvm`` alone. ``calibrated``: scale predicted variances by what the mapper misses of
    key poses left out (:mod:`physretarget.mapping.calibration`); the means are the same without,
    which takes half the time. Raises UsageError for an unknown name, InputError for key poses
    that cannot be used.

    Args:
        name: One of ``NAMES``.
        y: (N, DY) actor features, m.
        z: (N, DZ) character features, m.
        dims: Latent dimensions of sgplvm and pca, below N.
        iterations: Of learning sgplvm.
        seed: Of what is drawn while learning.
        calibrated: Scale the variance by left-out key poses.

    Returns:
        The mapper.
    """
    if dims < 1 or iterations < 1:
        raise UsageError(f"dims and iterations must be at least 1, not {dims} and {iterations}")
    if name == "sgplvm":
        return fit_gplvm(y, z, dims=dims, iterations=iterations, seed=seed, calibrated=calibrated)
    if name == "gp":
        return fit_gp(y, z, calibrated=calibrated)
    if name == "pca":
        return fit_pca(y, z, dims=dims)
    if name == "ridge":
        return fit_ridge(y, z)
    if name in ("nn3", "nn10"):
        return fit_nearest(y, z, neighbours=int(name[2:]))
    raise UsageError(f"unknown mapper '{name}'; the mappers are {', '.join(NAMES)}")


def from_arrays(arrays: Arrays) -> Mapper:
    """Rebuild a mapper from what its ``to_arrays`` gave.

    Args:
        arrays: Name → array.

    Returns:
        The mapper.
    """
    name = str(arrays.get("mapper", ""))
    kinds: dict[str, type[SharedGPLVM | GaussianProcess | PrincipalMap | NearestPoses]] = {
        "sgplvm": SharedGPLVM,
        "gp": GaussianProcess,
        "ridge": PrincipalMap,
        "pca": PrincipalMap,
        "nn3": NearestPoses,
        "nn10": NearestPoses,
    }
    if name not in kinds:
        raise InputError(f"not a learned mapper: its kind is '{name}', not one of {list(kinds)}")
    try:
        return kinds[name].from_arrays(arrays)
    except KeyError as missing:
        raise InputError(f"the learned mapper lacks the array {missing}") from missing
