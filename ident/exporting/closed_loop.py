"""The drive law of a fit as numbers per joint, all known, in the units in which simulators have them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drives.given import VelocityCommand
from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..drives.result import DriveFit

Array = np.ndarray
#: What only some laws have.
_OPTIONAL = ("per_volt", "ki", "no_load_speed", "command_lag_s", "deadband")


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """τ = kp (q_cmd(t − delay_s) − q) + kd (dq_cmd(t − delay_s) − dq) within ±effort_limit, less back_emf dq; (n,) each, N m and rad.

    `gear_loss`, `gear_loss_square`, `gear_loss_slow`, `slow_speed`: dry friction that follows τ; `joint_stiffness`, `joint_damping`: of the
    spring between motor and link (infinite: none). `velocity_command`: whether the drive is sent a velocity too. `per_volt`: N m/V of a
    drive that is sent a voltage, kp and kd 0; None: it is not. `ki` (N m/(rad s)): of one that integrates its error as well, which stands
    still while the limit holds and the error would wind it further; None: it does not. `no_load_speed` (rad/s), at which the limit is
    nothing along the motion; None: it stays. `command_lag_s`: time constant of the filter that smooths q_cmd and dq_cmd; None: there is
    none. `deadband` (rad): errors of position count by what they are beyond it; None: all do."""

    kp: Array
    kd: Array
    effort_limit: Array
    delay_s: Array
    back_emf: Array
    gear_loss: Array
    gear_loss_square: Array
    gear_loss_slow: Array
    slow_speed: Array
    joint_stiffness: Array
    joint_damping: Array
    kind: str = "pd_position"
    velocity_command: bool = False
    per_volt: Array | None = None
    ki: Array | None = None
    no_load_speed: Array | None = None
    command_lag_s: Array | None = None
    deadband: Array | None = None

    @classmethod
    def of(cls, fit: DriveFit, supply: float | None = None) -> ClosedLoop:
        """Constants of a fit; those of a pwm law at a supply voltage. Raises ConfigurationError where one is not known."""
        found, scale = fit.constants(), 1.0
        if fit.law.kind == "pwm":
            if supply is None:
                raise ConfigurationError(
                    "the torque of a pwm law depends on the supply voltage: give the voltage to export for (--supply V, supply=)."
                )
            scale = float(supply)
        strength = scale * found["torque_scale"]
        own = {f.name: found[f.name] for f in fields(cls) if f.name in found and f.name not in _OPTIONAL}
        own |= {"no_load_speed": found["no_load_speed"]} if fit.law.droops.any() else {}
        own |= {key: found[key] for key in ("command_lag_s", "deadband") if found[key].any()}
        gains = ("kp", "kd", "effort_limit", *(("ki",) if fit.law.integrates.any() else ()))
        own |= {key: strength * found[key] for key in gains}
        for key, values in own.items():
            for joint, value in zip(fit.model.robot.joint_names, values, strict=True):
                if np.isnan(value):
                    raise ConfigurationError(
                        f"{key} of joint {joint!r} is given for single logs only ([drive.by_log]); give the value to export in [drive]."
                    )
        if fit.law.kind == "voltage":
            own["per_volt"] = strength
        rates = fit.law.kind == "pd_velocity" or fit.law.velocity_command == VelocityCommand.DERIVATIVE
        return cls(**own, kind=fit.law.kind, velocity_command=rates)

    def losses(self, torque: Array, dq: Array) -> Array:
        """Level (N, n) of dry friction that follows the drive's torque (N, n)."""
        size = np.abs(torque)
        slow = np.exp(-np.square(dq / self.slow_speed))
        return size * (self.gear_loss + self.gear_loss_square * size + self.gear_loss_slow * slow)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; infinite values are None."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("kind", "velocity_command", *_OPTIONAL)}
        arrays |= {key: values for key in _OPTIONAL if (values := getattr(self, key)) is not None}
        plain = {key: [float(x) if np.isfinite(x) else None for x in values] for key, values in arrays.items()}
        return {"kind": self.kind, "velocity_command": self.velocity_command, **plain}
