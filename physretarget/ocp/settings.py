"""What the root-height optimisation weighs against what: three presets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from physretarget.errors import UsageError
from physretarget.options.retargeting import Physics, Solver

PRESETS: tuple[Physics, ...] = get_args(Physics)


@dataclass(frozen=True, kw_only=True)
class ContactModel:
    """Parameters of Yamane 2010 eqs. (13) and (14), SI units, per contact point.

    ``stiffness`` k_P (N/m), ``damping`` k_D (N s/m), ``residual`` f0 (N, the force at zero
    height), ``reach`` k (1/m, how fast damping fades with height), ``friction`` μ,
    ``slip_damping`` k_tD (s/m), ``slip_gain`` k_t. The paper's tangential spring k_tP is zero
    there and left out here.
    """

    stiffness: float
    damping: float
    residual: float
    reach: float
    friction: float = 1.0
    slip_damping: float = 100.0
    slip_gain: float = 20.0


PAPER_MODEL = ContactModel(stiffness=1e4, damping=1.0, residual=1.0, reach=20.0)
"""The values printed in Yamane 2010, section 6.3 (units not given there, SI assumed)."""


@dataclass(frozen=True, kw_only=True)
class RootHeightSettings:
    """Weights and limits of the root-height optimisation.

    With ``dimensionless`` every residual is a ratio: forces over body weight, moments over body
    weight times height, lengths over height; and the contact model is scaled with them. Without
    it residuals are in SI units and :data:`PAPER_MODEL` is taken as it stands.

    interval: seconds between centres of the Gaussians; their σ is twice that.
    vertical, horizontal, moment: weights of the three parts of the wrench mismatch.
    flight: weight of the required vertical force in flight frames (no active contact point).
    hold: weight of leaving the height at which a standing character rests on the contact model:
    without it the cheapest way to a small mismatch is to bounce through every stance.
    displacement: weight of the displacement itself; roughness: of its acceleration over g.
    pose: weight of the mapper's log-likelihood Z_m; ``pose_floor`` is the least standard
    deviation taken from the mapper, over the height.
    weights: weight of ½wᵀw.
    limit: largest displacement over the height.
    floor: how deep any part of the body, rounded toes and tails included, may be pushed into the
    floor, over the height.
    sink: how deep the contact model sinks under one body weight, over the height.
    continuation: multiples of the model's f0, solved one after another.
    iterations, tolerance: of Gauss-Newton in each of those, relative decrease.
    solver: ``banded`` (Gauss-Newton) or ``ipopt``, which has limits of its own.
    """

    name: Physics = "default"
    dimensionless: bool = True
    interval: float = 1.0 / 60.0
    vertical: float = 1.0
    horizontal: float = 0.0
    moment: float = 0.0
    flight: float = 4.0
    displacement: float = 0.5
    hold: float = 100.0
    roughness: float = 0.15
    pose: float = 0.005
    pose_floor: float = 0.05
    weights: float = 1e-6
    limit: float = 0.15
    floor: float = 0.013
    sink: float = 0.0005
    continuation: tuple[float, ...] = (30.0, 10.0, 3.0, 1.0)
    iterations: int = 30
    tolerance: float = 1e-3
    solver: Solver = "banded"

    @classmethod
    def preset(cls, name: str) -> RootHeightSettings:
        """``default``, ``paper`` (literal values, cold start) or ``convex``."""
        if name == "default":
            return cls()
        if name == "convex":
            return cls(name="convex", horizontal=0.1, moment=0.1)
        if name == "paper":
            return cls(
                name="paper",
                dimensionless=False,
                vertical=1e-5**0.5,
                horizontal=1e-5**0.5,
                moment=1e-5**0.5,
                flight=0.0,
                displacement=0.0,
                hold=0.0,
                roughness=0.0,
                pose=1.0,
                pose_floor=0.0,
                weights=1.0,
                limit=float("inf"),
                floor=float("inf"),
                continuation=(1.0,),
                interval=1.0 / 15.0,
                iterations=200,
            )
        raise UsageError(f"unknown physics preset '{name}'; the presets are {', '.join(PRESETS)}")

    def contact_model(self, weight: float, height: float, points: int, mu: float) -> ContactModel:
        """The contact model for a character of ``weight`` (N) and ``height`` (m)."""
        if not self.dimensionless:
            return PAPER_MODEL
        share = weight / max(points, 1)
        stiffness = share / (self.sink * height)
        # damping that takes a twentieth of the weight at the speed of a fall from the height
        damping = 0.05 * share / (2.0 * 9.81 * height) ** 0.5
        return ContactModel(
            stiffness=stiffness,
            damping=damping,
            residual=0.03 * share,
            reach=1.0 / (self.sink * height),
            friction=mu,
        )
