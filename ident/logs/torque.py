"""Torque on the measured side of the transmission, from whatever a log holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import ConfigurationError, DataError
from ..robots.transmission import Side, Transmission

Array = np.ndarray


class TorqueColumns(Protocol):
    """A log, as far as its torque is concerned: its name, torque or current by side, and a hint where there is neither."""

    @property
    def name(self) -> str: ...

    @property
    def tau(self) -> Mapping[str, Array]: ...

    @property
    def hint(self) -> str: ...


@dataclass(frozen=True)
class MeasuredTorque:
    """Torque (N, n) on the measured side, NaN where none was logged, and how it was obtained."""

    torque: Array
    notes: tuple[str, ...] = ()


def as_meant(arrays: dict[str, Array], meaning: str | None, sign: tuple[float, ...], where: str) -> list[str]:
    """Put a torque whose column does not tell what it is where it belongs, in place; notes. `meaning`, `sign`: as of `read_logs`.

    Raises DataError for a torque that no model of the robot can be fitted to, and for signs of another number of joints."""
    notes = []
    told = [k for k in arrays if k.startswith("tau_")]
    if meaning == "external":
        raise DataError(
            f"{where}: its torque is declared external: gravity, inertia and friction have been removed from it, so nothing of the"
            f" robot's own dynamics can be identified from it. Log the measured joint torque, or the motor currents."
        )
    if meaning == "none":
        for key in told:
            del arrays[key]
    if meaning == "link" and told == ["tau_motor"]:
        arrays["tau_joint"] = arrays.pop("tau_motor")
    if meaning in ("motor", "current") and told == ["tau_joint"]:
        arrays[f"tau_{meaning}"] = arrays.pop("tau_joint")
    if meaning in ("estimated", "command") and told:
        what = "an estimate" if meaning == "estimated" else "a command"
        notes.append(f"{where}: the torque is {what}, not a measurement: the parameters can only be as good as whatever produced it.")
    if any(x != 1.0 for x in sign):
        for key in [k for k in arrays if k.startswith("tau_")]:
            if len(sign) not in (1, arrays[key].shape[1]):
                raise DataError(f"{where}: torque_sign has {len(sign)} entries, but there are {arrays[key].shape[1]} joints.")
            arrays[key] = arrays[key] * np.array(sign)
    return notes


def measured(log: TorqueColumns, transmission: Transmission) -> MeasuredTorque:
    """Torque on the transmission's measured side.

    Taken as logged on that side; else currents times torque constants (motor side); else carried through K from the other
    side, which is said. Raises DataError without torque, ConfigurationError for currents without torque constants."""
    side = transmission.measured
    if side.value in log.tau:
        return MeasuredTorque(log.tau[side.value])
    other = Side.MOTOR if side == Side.JOINT else Side.JOINT
    if other.value in log.tau:
        torque = _through(log.tau[other.value], transmission.torque_map(other, side))
        if not np.allclose(transmission.K, np.eye(transmission.n)):
            note = f"log {log.name}: torque was logged on the {other} side and is mapped to the {side} side through K."
        elif other == Side.MOTOR:
            note = (
                f"log {log.name}: the torque is the motors', and no gears are declared: each motor is taken to drive its joint one"
                f" to one."
                ' Give [drive] ratio = [...] (--drive FILE), or for direct drives measured = "motor".'
            )
        else:
            note = ""
        return MeasuredTorque(torque, (note,) if note else ())
    if "current" in log.tau:
        if transmission.torque_constants is None:
            raise ConfigurationError(
                f"log {log.name} holds currents, but the drive has no torque constants. Give [drive] torque_constants ="
                " [...] in N m/A, one per motor."
            )
        torque = log.tau["current"] * transmission.torque_constants
        if side == Side.MOTOR:
            return MeasuredTorque(torque, (f"log {log.name}: motor torque is current times torque constant.",))
        torque = _through(torque, transmission.torque_map(Side.MOTOR, Side.JOINT))
        return MeasuredTorque(torque, (f"log {log.name}: torque is current times torque constant, mapped to the joint side through K.",))
    asked = f"; {log.hint}" if log.hint else ". Map the columns under [columns] of a study file."
    raise DataError(f"log {log.name}: holds no torque or current (tau1, tau_m1 or i1 …); there is nothing to fit to{asked}")


def _through(torque: Array, T: Array) -> Array:
    """Map torque by T; a joint without torque spoils only the rows that need it."""
    finite = np.isfinite(torque)
    out = np.where(finite, torque, 0.0) @ T.T
    if not finite.all():
        out[((~finite).astype(float) @ (T != 0).T.astype(float)) > 0] = np.nan
    return out
