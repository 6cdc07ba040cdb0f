"""A fit beside the URDF's inertials: torque in another unit, and time in another, give themselves away by factors that no link has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: The inertials of a URDF are right within this factor where they are of the right pattern at all: where two factors, of gravity and of
#: inertia, leave no more than this share of a joint's torque.
_FACTOR, _LEFT = 3.0, 0.3
#: What the URDF asks for, or what is fitted, must stand so far above the noise of the fit.
_CLEAR = 10.0


@dataclass(frozen=True)
class _Beside:
    """Nominal base values (b,) beside fitted ones; which of them no drive's inertia is grouped into (`plain`), and which are `inertia`."""

    estimate: Estimate
    nominal: Array
    plain: Array
    inertia: Array

    def factors(self, j: int) -> tuple[float | None, float | None]:
        """How many times gravity and inertia are, in one joint's torque, what the nominal values ask for, beside friction and rotors,
        which are free; None for what is not told."""
        information = self.estimate.information
        assert information is not None
        R = float(np.sqrt(max(self.estimate.weights[j], 0.0))) * information.factors[j]
        free = R[:, :-1][:, ~self.plain]
        basis = np.linalg.svd(free, full_matrices=False)[0][:, : int(np.linalg.matrix_rank(free))] if free.size else free
        parts = [R[:, :-1] @ np.where(chosen, self.nominal, 0.0) for chosen in (self.plain & ~self.inertia, self.plain & self.inertia)]
        A, z = (v - basis @ (basis.T @ v) for v in (np.stack(parts, axis=1), R[:, -1]))
        found = np.linalg.lstsq(A, z, rcond=1e-9)[0]
        left = float(np.linalg.norm(z - A @ found))
        if left > _LEFT * max(float(np.linalg.norm(z)), float(np.linalg.norm(A))):
            return None, None
        size = [float(np.linalg.norm(A[:, k] - _along_of(A[:, 1 - k], A[:, k]))) for k in (0, 1)]
        gravity, inertia = (
            max(abs(float(k)), 1.0 / one) if one > 0.0 and max(one, one * abs(float(k))) > _CLEAR else None
            for k, one in zip(found, size, strict=True)
        )
        return gravity, inertia


def factor_doubt(estimate: Estimate) -> str:
    """A sentence where torque, or the part of it that inertia takes, is that of the URDF times a factor no link has; "" otherwise."""
    beside = _beside(estimate)
    if beside is None:
        return ""
    told = {name: beside.factors(j) for j, name in enumerate(estimate.model.robot.joint_names)}
    gravity = {name: g for name, (g, _) in told.items() if g is not None}
    inertia = {name: s for name, (_, s) in told.items() if s is not None}
    if not gravity and not inertia:
        return ""
    heavy, swung = (float(np.median(list(k.values()))) if k else None for k in (gravity, inertia))
    if heavy is not None and swung is not None and _usual(heavy) and not _usual(swung / heavy):
        return _of_the_clock(heavy, swung)
    middle = swung if heavy is None else heavy
    assert middle is not None
    if len({*gravity, *inertia}) > 1 and not _usual(middle):
        return (
            f"torque is about {middle:.2g} times what the URDF's inertials ask for, on all joints: look at its unit, at the side of the"
            " gears that it is of ([drive] measured, torque, ratio), and at the torque constants."
        )
    odd = {name: k for part in (inertia, gravity) for name, k in part.items() if not _usual(k / middle)}
    # A joint is odd where all that is known of its torque is.
    odd = {name: k for name, k in odd.items() if all(not _usual(x / middle) for x in told[name] if x is not None)}
    if not odd or 2 * len(odd) >= len({*gravity, *inertia}):
        return ""
    listed = ", ".join(f"{name} ({k:.2g})" for name, k in odd.items())
    return (
        f"torque is many times, or a small part of, what the URDF's inertials ask for on some joints alone: {listed}. Look at its unit,"
        " its gear ratio and its torque constant there."
    )


def _of_the_clock(heavy: float, swung: float) -> str:
    times, way = np.sqrt(max(swung / heavy, heavy / swung)), "slowly" if swung > heavy else "fast"
    return (
        f"gravity is {heavy:.2g} times what the URDF's inertials ask for, but inertia {swung:.2g} times: time that runs about {times:.2g}"
        f" times too {way} does that. Look at the unit of the time, and at rate_hz; or the URDF's inertias are made up."
    )


def _usual(factor: float) -> bool:
    return 1.0 / _FACTOR < abs(factor) < _FACTOR


def _along_of(v: Array, x: Array) -> Array:
    """The part of x that lies along v."""
    size = float(v @ v)
    return v * (float(v @ x) / size) if size > 0.0 else np.zeros_like(v)


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
    plain = np.array([ok and p.name not in about_axis for ok, p in zip(alone, own, strict=True)], bool)
    inertia = np.array([p.unit == "kg m^2" for p in own], bool)
    return _Beside(estimate, base.base_values(start), plain, inertia)


def _along(axis: Array) -> str:
    """The axes along which a joint's own inertia may lie."""
    return "".join(name for name, x in zip("xyz", axis, strict=True) if abs(x) > 1e-6)
