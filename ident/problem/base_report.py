"""What a robot reveals, as text and JSON: its base parameters, and what is not identifiable and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.text import counted
from .._utils.threads import with_one_blas_thread
from ..regressor.base_parameters.base_form import BaseForm
from ..regressor.base_parameters.expressions import parameter_unit, split_name
from ..regressor.base_parameters.principal import PrincipalParameters
from ..regressor.base_parameters.structural import StructuralSet, base_set
from .agreement import Agreement, agreement

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_PROBED = "part of the loop closure has too many functions of position to be resolved one by one; it was probed at generic positions."


@dataclass(frozen=True)
class Unidentifiable:
    """A parameter that no motion determines by itself: `grouped_into` names the base parameters it is part of, () if it has no
    effect on any torque; `why` says so in words."""

    parameter: str
    why: str
    grouped_into: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class BaseReport(ShortRepr):
    """Base parameters of a robot: `base`; `unidentifiable`, in order; `agreement` of all ways to find them; `principal` directions
    for a trajectory, if asked for; `notes`."""

    robot: Robot
    base: StructuralSet
    unidentifiable: tuple[Unidentifiable, ...]
    agreement: Agreement
    principal: PrincipalParameters | None = None
    notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        return self.base.count

    @property
    def closed_form(self) -> BaseForm | None:
        """The first theorem that covers the robot, None if none does."""
        return self.agreement.closed[0] if self.agreement.closed else None

    def to_dict(self) -> dict[str, Any]:
        """JSON form `ident.base/1`, without what every result carries (schema, version, inputs, created)."""
        base = self.base
        out: dict[str, Any] = {
            "count": base.count,
            "count_formula": base.count_formula,
            "parameters": [
                {"name": n, "expression": e, "unit": parameter_unit(n)} for n, e in zip(base.names, base.expressions, strict=True)
            ],
            "unidentifiable": [{"parameter": u.parameter, "why": u.why, "grouped_into": list(u.grouped_into)} for u in self.unidentifiable],
            # Links in Pinocchio's order; behind them the rotors, where their inertias are parameters too.
            "columns": list(base.columns if base.rotor_matrix.any() else base.parameters),
            "matrix": (base.full if base.rotor_matrix.any() else base.matrix).tolist(),
            "agreement": self.agreement.to_dict(),
            "closed_forms": [
                {
                    "method": f.method,
                    "count_formula": f.count_formula,
                    "parameters": [{"name": n, "expression": e} for n, e in zip(f.names, f.expressions, strict=True)],
                }
                for f in self.agreement.closed
            ],
            "notes": list(self.notes),
        }
        if self.principal is not None:
            out["principal"] = [
                {"sensitivity": float(s), "expression": e}
                for s, e in zip(self.principal.sensitivity, self.principal.expressions, strict=True)
            ]
        return out

    def text(self) -> str:
        """For people."""
        base, robot = self.base, self.robot
        shown = len(base.parameters) + int(base.rotor_matrix.any(axis=0).sum())
        prismatic = sum(j.prismatic for j in robot.tree_joints)
        kinds = [f"{len(robot.tree_joints) - prismatic} revolute", f"{prismatic} prismatic"]
        joints = " and ".join(k for k in kinds if not k.startswith("0"))
        extra = (", floating base" if robot.floating_base else "") + ("" if robot.loop.is_trivial else f", {robot.n} of them independent")
        lines = [f"{robot.name}: {counted(base.count, 'base parameter')} of {shown} ({joints} joints{extra})"]
        form = self.closed_form
        motors = base.count - (form.count if form else 0)
        beside = f", and {motors} of the motors" if form and motors else ""
        lines.append(f"  count: {form.count_formula} (closed form: {form.method}){beside}" if form else f"  count: {base.count_formula}")
        kept, dropped = self.agreement.sampled.gap
        ways = ", ".join(f"{name} {count}" for name, count in self.agreement.counts.items())
        margins = f"singular values of the sampled regressor: kept down to {kept:.1e}, dropped from {dropped:.1e}"
        lines.append(f"  {'agree' if self.agreement else 'DO NOT AGREE'}: {ways}; {margins}")
        if not self.agreement:
            lines += [f"    {line}" for line in str(self.agreement).splitlines()[1:]]
        lines += ["", "Base parameters (coefficients in the unit of the base parameter over that of the term)"]
        width = max((len(n) for n in base.names), default=0)
        for name, text in zip(base.names, base.expressions, strict=True):
            lines.append(f"  {name:<{width}}  {f'[{parameter_unit(name)}]':<8}  {text}")
        lines += self._hidden_lines()
        if self.principal is not None:
            lines += ["", *str(self.principal).splitlines()]
        return "\n".join([*lines, *(f"note: {n}" for n in self.notes)])

    def _hidden_lines(self) -> list[str]:
        none = [u for u in self.unidentifiable if not u.grouped_into]
        grouped = [u for u in self.unidentifiable if u.grouped_into]
        lines: list[str] = []
        if none:
            lines += ["", "Not identifiable: no effect on any torque"]
            by_reason: dict[tuple[str, str], list[str]] = {}
            for u in none:
                by_reason.setdefault((split_name(u.parameter)[1], u.why), []).append(u.parameter)
            lines += [f"  {' '.join(names)}: {why.partition(': ')[2]}" for (_, why), names in by_reason.items()]
        if grouped:
            width = max(len(u.parameter) for u in grouped)
            lines += ["", "Not identifiable by itself: only in combination, grouped into"]
            lines += [f"  {u.parameter:<{width}}  {', '.join(u.grouped_into)}" for u in grouped]
        return lines

    def __str__(self) -> str:
        return self.text()


@with_one_blas_thread
def base_report(robot: Robot, rotor_inertia: bool | Sequence[str] = False, principal: PrincipalParameters | None = None) -> BaseReport:
    """Base parameters of a robot in readable expressions, and the reason for each parameter that no motion shows alone.

    Parameters
    ----------
    robot : Robot
        Links with or without inertial values; only the kinematics count.
    rotor_inertia : bool or sequence of str
        True, or names of joints whose motors' reflected inertias count as parameters too.
    principal : PrincipalParameters, optional
        Principal directions of a trajectory, to be printed with them.

    Returns
    -------
    BaseReport
        Base parameters, and the agreement of closed form, structure and samples on the space they span.

    Raises
    ------
    ConfigurationError
        An unknown joint.

    References
    ----------
    M. Gautier and W. Khalil, "Direct calculation of minimum set of inertial parameters of serial robots", IEEE Trans. Robotics and
    Automation 6(3), 1990. H. Mayeda, K. Yoshida and K. Osuka, "Base parameters of manipulator dynamic models", ibid.

    Examples
    --------
    >>> import ident
    >>> report = ident.base(ident.load_robot("puma560"))
    >>> report.count
    36
    """
    base = base_set(robot, rotor_inertia)
    check = agreement(robot, bool(rotor_inertia)) if not isinstance(rotor_inertia, Sequence) else agreement(robot)
    hidden = tuple(_unidentifiable(base))
    notes = tuple(robot.notes) + base.notes
    if not base.exact:
        notes += (_PROBED,)
    return BaseReport(robot, base, hidden, check, principal, notes)


def _unidentifiable(base: StructuralSet) -> list[Unidentifiable]:
    full, columns = base.full, base.columns
    kept = set(base.kept.tolist())
    size = np.abs(full).max(axis=0, initial=0.0)
    asked = np.r_[np.ones(len(base.parameters), bool), base.rotor_matrix.any(axis=0)]
    out = []
    for index in np.flatnonzero(asked):
        name = columns[index]
        if index in kept:
            continue
        into = tuple(base.names[row] for row in np.flatnonzero(full[:, index]))
        if size[index] == 0.0:
            link = index < len(base.parameters)
            reason = _why_hidden(split_name(name)[0], base.turning[index // 10]) if link else "its motor moves nothing that is measured"
            why = f"no effect on any torque: {reason}"
            out.append(Unidentifiable(name, why, ()))
        else:
            out.append(Unidentifiable(name, f"only in combination, grouped into {', '.join(into)}", into))
    return out


def _why_hidden(symbol: str, turning: int) -> str:
    """Why a link's parameter shows in no torque; `turning`: dimension of the link's angular velocities."""
    if symbol == "m":
        return "the origin of its frame never moves"
    if symbol.startswith("I"):
        ways = {0: "the link never turns", 1: "the link only ever rotates about one axis"}
        return ways.get(turning, "no rotation of the link excites it")
    return "neither the motion of its frame's origin nor gravity excites it"
