"""An interior-point method for the cone fit, all frames at once.

Primal-dual path following with Nesterov-Todd scaling and Mehrotra's corrector, as in
Vandenberghe's notes on CVXOPT's cone programmes (2010). Takes some fifteen iterations whatever
the data; the Newton method of :mod:`physretarget.ground.cones` is faster where it does not
zigzag, and finishes to full precision what this one begins.

    minimise 1/2 |b - A x|^2 + 1/2 sum rho |x_i|^2 over x_i in the second-order cone,

x_i = (tangent, tangent, normal), slack s = rho x - A^T (b - A x), x o s = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ITERATIONS = 40
_GAP = 1e-8
# Steps keep this share of the way to the cone's boundary.
_SHARE = 0.99
_UNIT = np.array([0.0, 0.0, 1.0])
_SIGN = np.array([-1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class _Scaling:
    """Nesterov-Todd scaling of every point: W x = W^-1 s = lam."""

    eta: Floats  # (B, n, 1)
    w: Floats  # (B, n, 3), w in the cone with w J w = 1
    lam: Floats  # (B, n, 3)

    @classmethod
    def of(cls, x: Floats, s: Floats) -> _Scaling:
        x_size, s_size = _size(x), _size(s)
        x_unit, s_unit = x / x_size, s / s_size
        gamma = np.sqrt(0.5 * (1 + _dot(x_unit, s_unit)))
        w = (s_unit + _SIGN * x_unit) / (2 * gamma)
        eta = np.sqrt(s_size / x_size)
        bare = cls(eta, w, x)
        return cls(eta, w, bare.times(x))

    def times(self, v: Floats) -> Floats:
        """W v."""
        return self.eta * _hyperbolic(self.w, v)

    def over(self, v: Floats) -> Floats:
        """W^-1 v."""
        return _hyperbolic(_SIGN * self.w, v) / self.eta

    def inverse(self, rho: Floats) -> Floats:
        """(W^2 + rho)^-1, (B, n, 3, 3), from the eigenvectors (+-u, 1) and the one across.

        W^2 = eta^2 (2 w w' - J) loses its small eigenvalue to rounding near the cone's
        boundary; here it is the inverse of the large one.
        """
        tangent = np.hypot(self.w[..., 0], self.w[..., 1])
        safe = np.where(tangent > 0, tangent, 1.0)
        ux = np.where(tangent > 0, self.w[..., 0] / safe, 1.0)
        uy = np.where(tangent > 0, self.w[..., 1] / safe, 0.0)
        large = (self.w[..., 2] + tangent) ** 2
        scale = self.eta[..., 0] ** 2
        plus, minus = 0.5 / (scale * large + rho), 0.5 / (scale / large + rho)
        across = 1 / (scale + rho)
        inverse = np.empty((*self.w.shape, 3))
        along, mixed = plus + minus - across, plus - minus
        inverse[..., 0, 0] = across + along * ux * ux
        inverse[..., 1, 1] = across + along * uy * uy
        inverse[..., 0, 1] = inverse[..., 1, 0] = along * ux * uy
        inverse[..., 0, 2] = inverse[..., 2, 0] = mixed * ux
        inverse[..., 1, 2] = inverse[..., 2, 1] = mixed * uy
        inverse[..., 2, 2] = plus + minus
        return inverse


def interior_point(a: Floats, b: Floats, rho: Floats) -> Floats:
    """Residual b - A x (B, 6) at the minimum; ``a`` (B, 3n, 6) is A^T, ``rho`` (B, n)."""
    frames, points = rho.shape
    maps = a.reshape(frames, points, 3, 6)
    size = np.maximum(np.abs(b).max(axis=1), 1e-6)[:, None, None]
    x = np.broadcast_to(_UNIT * size, (frames, points, 3)).copy()
    s = x.copy()
    live = np.arange(frames)
    for _ in range(_ITERATIONS):
        dual = (
            rho[live, :, None] * x[live]
            - s[live]
            - _adjoint(maps[live], _residual(maps[live], b[live], x[live]))
        )
        mean = np.sum(x[live] * s[live], axis=(1, 2)) / points
        scale = size[live, 0, 0]
        going = mean > _GAP * scale**2
        live, dual, mean = live[going], dual[going], mean[going]
        if len(live) == 0:
            break
        with np.errstate(all="ignore"):
            moved = _iterate(maps[live], rho[live], x[live], s[live], dual, mean)
        # At the limit of rounding a point can leave its cone: that frame stays where it was.
        sound = _inside(moved[0]) & _inside(moved[1])
        live = live[sound]
        x[live], s[live] = moved[0][sound], moved[1][sound]
    return _residual(maps, b, x)


def _iterate(
    maps: Floats, rho: Floats, x: Floats, s: Floats, dual: Floats, mean: Floats
) -> tuple[Floats, Floats]:
    """One predictor and corrector step."""
    scaling = _Scaling.of(x, s)
    solve = _solver(maps, scaling, rho)
    dx, ds = solve(dual, -scaling.lam)
    step = np.minimum(_reach(x, dx), _reach(s, ds))
    target = (1 - step) ** 3 * mean[:, None, None] * _UNIT
    target = target - _product(scaling.lam, scaling.lam)
    target -= _product(scaling.times(dx), scaling.over(ds))
    dx, ds = solve(dual, _divide(scaling.lam, target))
    step = np.minimum(1.0, _SHARE * np.minimum(_reach(x, dx), _reach(s, ds)))
    return x + step * dx, s + step * ds


def _inside(v: Floats) -> NDArray[np.bool_]:
    """(B,) all points finite and strictly inside the cone."""
    strictly = v[..., 2] > np.hypot(v[..., 0], v[..., 1])
    return np.asarray(np.all(strictly & np.isfinite(v).all(axis=-1), axis=1), dtype=np.bool_)


def _residual(maps: Floats, b: Floats, x: Floats) -> Floats:
    left: Floats = b - np.einsum("bnik,bni->bk", maps, x)
    return left


def _adjoint(maps: Floats, y: Floats) -> Floats:
    product: Floats = np.einsum("bnik,bk->bni", maps, y)
    return product


def _solver(
    maps: Floats, scaling: _Scaling, rho: Floats
) -> Callable[[Floats, Floats], tuple[Floats, Floats]]:
    """Solve the Newton system through its 6 x 6 Schur complement."""
    inverse = scaling.inverse(rho)
    weighted = inverse @ maps
    schur = np.eye(6) + np.einsum("bnik,bnil->bkl", maps, weighted)

    def solve(dual: Floats, corrected: Floats) -> tuple[Floats, Floats]:
        right = -dual + scaling.times(corrected)
        first = (inverse @ right[..., None])[..., 0]
        inner = np.linalg.solve(schur, np.einsum("bnik,bni->bk", maps, first)[..., None])
        dx = first - np.einsum("bnik,bk->bni", weighted, inner[..., 0])
        # From the dual equation, which keeps its rounding out of later steps; W c - W^2 dx is
        # the same in exact arithmetic.
        moved = np.einsum("bnik,bni->bk", maps, dx)
        return dx, rho[..., None] * dx + _adjoint(maps, moved) + dual

    return solve


def _dot(u: Floats, v: Floats) -> Floats:
    dot: Floats = np.sum(u * v, axis=-1, keepdims=True)
    return dot


def _size(v: Floats) -> Floats:
    """sqrt(n^2 - |t|^2), (..., 1)."""
    tangent = np.hypot(v[..., :1], v[..., 1:2])
    size: Floats = np.sqrt(np.maximum((v[..., 2:] - tangent) * (v[..., 2:] + tangent), 1e-300))
    return size


def _hyperbolic(w: Floats, v: Floats) -> Floats:
    """[[w0, w1'], [w1, 1 + w1 w1' / (1 + w0)]] v, w0 the normal part."""
    along = _dot(w[..., :2], v[..., :2])
    out = np.empty_like(v)
    out[..., 2:] = w[..., 2:] * v[..., 2:] + along
    out[..., :2] = v[..., :2] + w[..., :2] * (v[..., 2:] + along / (1 + w[..., 2:]))
    return out


def _product(u: Floats, v: Floats) -> Floats:
    """Jordan product: normal part u.v, tangential u0 v1 + v0 u1."""
    out = np.empty_like(u)
    out[..., 2:] = _dot(u, v)
    out[..., :2] = u[..., 2:] * v[..., :2] + v[..., 2:] * u[..., :2]
    return out


def _divide(u: Floats, v: Floats) -> Floats:
    """The x with u o x = v."""
    out = np.empty_like(v)
    out[..., 2:] = (u[..., 2:] * v[..., 2:] - _dot(u[..., :2], v[..., :2])) / _size(u) ** 2
    out[..., :2] = (v[..., :2] - out[..., 2:] * u[..., :2]) / u[..., 2:]
    return out


def _reach(v: Floats, d: Floats) -> Floats:
    """(B, 1, 1) longest step, at most 1, that keeps every v + step d in the cone."""
    a = d[..., 2] ** 2 - d[..., 0] ** 2 - d[..., 1] ** 2
    b = v[..., 2] * d[..., 2] - v[..., 0] * d[..., 0] - v[..., 1] * d[..., 1]
    c = np.maximum(v[..., 2] ** 2 - v[..., 0] ** 2 - v[..., 1] ** 2, 0.0)
    # First positive root of a t^2 + 2 b t + c, in the form that does not cancel.
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    below = -b + root
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(below > 0, c / below, np.inf)
        apex = np.where(d[..., 2] < 0, -v[..., 2] / d[..., 2], np.inf)
    # No root where the ray stays inside: a >= 0 and b >= 0, or roots that are not real.
    outside = (a < 0) | ((b < 0) & (b * b >= a * c))
    step = np.minimum(np.where(outside, first, np.inf), apex)
    reach: Floats = np.minimum(step.min(axis=1), 1.0)[:, None, None]
    return reach
