"""The penalty contact model of Yamane 2010 eqs. (13) and (14) as CasADi expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca

from physretarget.ocp.settings import ContactModel

SMALL_SLIP = 1e-6
"""The paper's ε: below it h(s) takes its limit."""


def normal_force(height: Any, speed: Any, model: ContactModel, residual: Any) -> Any:
    """f_n (N) at ``height`` (m, negative inside the floor) and vertical ``speed``; eq. (13).

    ``residual`` stands for the model's f0, so that it can be continued.
    """
    k = model.stiffness
    spring = 0.5 * k * (ca.sqrt(height**2 + 4.0 * residual**2 / k**2) - height)
    # one exponential of -|z| serves both branches and cannot overflow
    fade = 0.5 * ca.exp(-model.reach * ca.fabs(height))
    active = ca.if_else(height < 0, 1.0 - fade, fade)
    return spring - model.damping * active * speed


def friction_force(slip: Any, normal: Any, model: ContactModel) -> Any:
    """f_t (2,) N at horizontal velocity ``slip`` (2,) m/s; eq. (14)."""
    drive = -model.slip_damping * slip
    size = ca.sqrt(ca.sumsqr(drive) + 1e-24)
    safe = ca.fmax(size, SMALL_SLIP)
    gain = ca.if_else(
        size > SMALL_SLIP, (1.0 - ca.exp(-model.slip_gain * safe)) / safe, model.slip_gain
    )
    return model.friction * normal * gain * drive
