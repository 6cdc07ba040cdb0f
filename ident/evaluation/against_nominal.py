"""A fit beside the URDF's inertials: torque in another unit, and time in another, give themselves away by factors that no link has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import lstsq, matrix_rank, svd
from ..physical.pseudo_inertia import displaced

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: The inertials of a URDF are right within this factor where they are of the right pattern at all: where two factors, of gravity and of
#: inertia, leave no more than this share of a joint's torque.
_FACTOR, _LEFT = 3.0, 0.3
#: What the URDF asks for, or what is fitted, must stand so far above the noise of the fit.
_CLEAR = 10.0
#: A parameter that is, even by so many standard deviations less, so many times the sum of its kind over all links of the URDF is no link's.
_SURELY, _MANY = 5.0, 30.0
#: A last link is the URDF's, turned, where turning takes away that much of the distance between both (squared standard deviations), and
#: leaves no more than this share; by less than so many radians it is not turned. Angles that are tried, and how often the step is halved.
_CLEAR_OFF, _LEFT_OFF, _TURNED, _ANGLES, _NARROWER = 100.0, 0.25, 0.05, 72, 8


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
        basis = svd(free, full_matrices=False)[0][:, : int(matrix_rank(free))] if free.size else free
        parts = [R[:, :-1] @ np.where(chosen, self.nominal, 0.0) for chosen in (self.plain & ~self.inertia, self.plain & self.inertia)]
        A, z = (v - basis @ (basis.T @ v) for v in (np.stack(parts, axis=1), R[:, -1]))
        found = lstsq(A, z, rcond=1e-9)
        left = float(np.linalg.norm(z - A @ found))
        if left > _LEFT * max(float(np.linalg.norm(z)), float(np.linalg.norm(A))):
            return None, None
        size = [float(np.linalg.norm(A[:, k] - _along_of(A[:, 1 - k], A[:, k]))) for k in (0, 1)]
        gravity, inertia = (
            max(abs(float(k)), 1.0 / one) if one > 0.0 and max(one, one * abs(float(k))) > _CLEAR else None
            for k, one in zip(found, size, strict=True)
        )
        return gravity, inertia

    def turned(self, j: int) -> float:
        """By how much the position of joint j, which carries body j alone, reads too far if that link is the URDF's (rad); 0 if it is not,
        or if it is so without turning."""
        robot, base, information = self.estimate.model.robot, self.estimate.base, self.estimate.information
        assert robot.nominal is not None
        assert information is not None
        R = information.combined(self.estimate.weights)[0]
        free = R[:, ~self.plain]
        basis = svd(free, full_matrices=False)[0][:, : int(matrix_rank(free))] if free.size else free
        link = slice(10 * j, 10 * j + 10)
        fitted = R @ self.estimate.values

        def apart(off: float) -> float:
            """Distance of the fit from the URDF's values, turned, in standard deviations squared."""
            values = np.zeros(len(base.parameters))
            values[: len(robot.nominal)] = robot.nominal  # type: ignore[arg-type]
            values[link] = displaced(values[link], _turn(robot.tree.axis[j], -off), np.zeros(3))
            v = fitted - R @ base.base_values(values)
            return float(np.sum((v - basis @ (basis.T @ v)) ** 2))

        grid = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
        step = float(grid[1] - grid[0])
        best = float(grid[int(np.argmin([apart(off) for off in grid]))])
        for _ in range(_NARROWER):
            step *= 0.5
            best = min((best - step, best, best + step), key=apart)
        here, there = apart(0.0), apart(best)
        return best if here - there > _CLEAR_OFF and there < _LEFT_OFF * here else 0.0


def _turn(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) by an angle about a unit axis."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


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
            f"torque is about {middle:.2g} times what the URDF's inertials predict, on all joints: check its unit, the"
            f" side of the gears that it is measured on ([drive] measured, torque, ratio), and the torque constants."
        )
    odd = {name: k for part in (inertia, gravity) for name, k in part.items() if not _usual(k / middle)}
    # A joint is odd where all that is known of its torque is.
    odd = {name: k for name, k in odd.items() if all(not _usual(x / middle) for x in told[name] if x is not None)}
    if not odd or 2 * len(odd) >= len({*gravity, *inertia}):
        return ""
    listed = ", ".join(f"{name} ({k:.2g})" for name, k in odd.items())
    return (
        f"torque is many times, or a small fraction of, what the URDF's inertials predict, on some joints only: {listed}."
        f" Check its unit, gear ratio and torque constant there."
    )


def size_doubt(estimate: Estimate) -> str:
    """A sentence where what is told of a link is many times what all links of the URDF have together, whatever its pattern; "" otherwise.

    Positions in another unit leave no pattern to compare: within small angles gravity is another function of them."""
    beside = _beside(estimate)
    if beside is None:
        return ""
    units = np.array([beside.estimate.base.parameters[i].unit for i in beside.estimate.base.independent])
    least = np.where(beside.plain, np.abs(estimate.values) - _SURELY * estimate.std, 0.0)
    found: list[str] = []
    for unit in dict.fromkeys(units.tolist()):
        whole = float(np.sum(np.abs(beside.nominal[beside.plain & (units == unit)])))
        large = np.flatnonzero((units == unit) & (least > _MANY * whole)) if whole > 0.0 else np.zeros(0, int)
        found += [f"{estimate.names[i]} = {estimate.values[i]:.3g} {unit} ({whole:.2g} in all links of the URDF)" for i in large]
    if not found:
        return ""
    return (
        f"parameters are many times what the URDF's links have: {', '.join(found[:3])}{' …' if len(found) > 3 else ''}."
        f" Positions or times in a wrong unit cause this: check the units of both, and rate_hz; or the URDF's inertials are placeholders."
    )


def zero_doubt(estimate: Estimate) -> str:
    """A sentence where the last link of a chain is the URDF's, but turned about its joint; "" otherwise.

    No motion tells the zero of a joint that carries one link alone: that link's parameters turn with it. Only what the URDF says of the
    link does, where it is right but for that."""
    beside = _beside(estimate)
    if beside is None:
        return ""
    robot = estimate.model.robot
    for j, name in enumerate(robot.joint_names):
        off = beside.turned(j) if robot.loop.is_trivial and j not in robot.tree.parent and not robot.joints[j].prismatic else 0.0
        if abs(off) > _TURNED:
            return (
                f"the link of {name} matches the URDF's, rotated about its joint: the zero of that joint is off (its position reads"
                f" {abs(off):.2g} rad too {'far' if off > 0 else 'little'}), or a tool is mounted differently. Parameters"
                f" of the link are given in rotated axes. Check [drive] zero."
            )
    return ""


def _of_the_clock(heavy: float, swung: float) -> str:
    times, way = np.sqrt(max(swung / heavy, heavy / swung)), "slowly" if swung > heavy else "fast"
    return (
        f"gravity is {heavy:.2g} times what the URDF's inertials predict, but inertia {swung:.2g} times: time that runs about {times:.2g}"
        f" times too {way} causes this. Check the unit of the time, and rate_hz; or the URDF's inertias are placeholders."
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
