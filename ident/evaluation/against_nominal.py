"""A fit beside the URDF's inertials: torque in another unit, and time in another, give themselves away by factors that no link has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: The inertials of a URDF are right within this factor where they are of the same pattern at all, which a correlation of so much shows.
_FACTOR, _PATTERN = 3.0, 0.95
#: What the URDF asks for, or what is fitted, must stand so far above the noise of the fit.
_CLEAR = 10.0


@dataclass(frozen=True)
class _Beside:
    """Nominal base values (b,) beside fitted ones; which of them no drive's inertia is grouped into (`plain`), and which are `inertia`."""

    estimate: Estimate
    nominal: Array
    plain: Array
    inertia: Array

    def asked(self, chosen: Array) -> tuple[Array, Array]:
        """What fitted and nominal values of some parameters ask of all joints, in standard deviations of the noise."""
        information = self.estimate.information
        assert information is not None
        roots = [np.sqrt(max(w, 0.0)) * R[:-1, :-1][:, chosen] for w, R in zip(self.estimate.weights, information.factors, strict=True)]
        rows = np.concatenate(roots)
        return rows @ self.estimate.values[chosen], rows @ self.nominal[chosen]

    def of_joint(self, j: int) -> float | None:
        """How many times one joint's torque is what the nominal values ask for, beside friction and rotors, which are free."""
        information = self.estimate.information
        assert information is not None
        weight = float(np.sqrt(max(self.estimate.weights[j], 0.0)))
        R = weight * information.factors[j]
        given, free = R[:, :-1] @ np.where(self.plain, self.nominal, 0.0), R[:, :-1][:, ~self.plain]
        basis = np.linalg.svd(free, full_matrices=False)[0][:, : int(np.linalg.matrix_rank(free))] if free.size else free
        x, z = (v - basis @ (basis.T @ v) for v in (given, R[:, -1]))
        return _factor(z, x)


def factor_doubt(estimate: Estimate) -> str:
    """A sentence where torque, or the part of it that inertia takes, is that of the URDF times a factor no link has; "" otherwise."""
    beside = _beside(estimate)
    if beside is None:
        return ""
    joints = estimate.model.robot.joint_names
    told = {name: k for j, name in enumerate(joints) if (k := beside.of_joint(j)) is not None}
    if not told:
        return ""
    middle = float(np.median(list(told.values())))
    if len(told) > 1 and not _usual(middle):
        return (
            f"torque is about {middle:.2g} times what the URDF's inertials ask for, on all joints: look at its unit, at the side of the"
            " gears that it is of ([drive] measured, torque, ratio), and at the torque constants."
        )
    odd = [f"{name} ({k:.2g})" for name, k in told.items() if not _usual(k / middle)]
    if odd and len(told) > len(odd):
        return (
            f"torque is many times, or a small part of, what the URDF's inertials ask for on some joints alone: {', '.join(odd)}. Look at"
            " its unit, its gear ratio and its torque constant there."
        )
    heavy, swung = _factor(*beside.asked(beside.plain & ~beside.inertia)), _factor(*beside.asked(beside.plain & beside.inertia))
    if heavy is None or swung is None or not _usual(heavy) or _usual(swung / heavy):
        return ""
    times, way = np.sqrt(max(swung / heavy, heavy / swung)), "slowly" if swung > heavy else "fast"
    return (
        f"gravity is {heavy:.2g} times what the URDF's inertials ask for, but inertia {swung:.2g} times: time that runs {times:.2g} times"
        f" too {way} does that. Look at the unit of the time, and at rate_hz; or the URDF's inertias are made up."
    )


def _usual(factor: float) -> bool:
    return 1.0 / _FACTOR < abs(factor) < _FACTOR


def _factor(fitted: Array, nominal: Array) -> float | None:
    """How many times the one is the other, at the most where it is lost in noise; None where they have not the same pattern, or where
    nothing is there. Both in standard deviations of the noise."""
    size, own = float(np.linalg.norm(nominal)), float(np.linalg.norm(fitted))
    if not max(size, own) > _CLEAR or not min(size, own) > 0.0:
        return None
    product = float(fitted @ nominal)
    if abs(product) > _PATTERN * size * own:
        return product / size**2
    return own / size if _FACTOR * own < size else None


def _beside(estimate: Estimate) -> _Beside | None:
    """Fitted values beside nominal ones; None without inertials or rows."""
    robot, information, base = estimate.model.robot, estimate.information, estimate.base
    if robot.nominal is None or information is None or base.names != information.names or base.names != estimate.names:
        return None
    rigid = np.array([p.effect == "rigid_body" for p in base.parameters])
    start = np.zeros(len(rigid))
    start[rigid] = robot.nominal
    alone = ~np.any(base.regroup[:, ~rigid] != 0, axis=1)
    own = [base.parameters[i] for i in base.independent]
    about_axis = {f"I{a}{a}_{joint}" for joint, axis in zip(robot.joint_names, robot.tree.axis, strict=False) for a in _along(axis)}
    plain = np.array([ok and p.name not in about_axis for ok, p in zip(alone, own, strict=True)])
    inertia = np.array([p.unit == "kg m^2" for p in own])
    return _Beside(estimate, base.base_values(start), plain, inertia)


def _along(axis: Array) -> str:
    """The axes along which a joint's own inertia may lie."""
    return "".join(name for name, x in zip("xyz", axis, strict=True) if abs(x) > 1e-6)
