"""Virtual parameters: base parameters given back to the links so that a recursive Newton-Euler pass costs less (Yoshida 1995, section 2.1).

A torque depends on the base parameters alone, so of all link parameters that have them, those with the most zeros may stand in for the real
ones. Links with such parameters are no bodies; their torques are exactly the robot's."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ConfigurationError
from ..robots.robot import Robot
from .base_parameters.reduction import BaseReduction
from .newton_euler import MOMENTS, AlignedTree, RecursivePass, aligned, write_pass

Array = np.ndarray
#: Moments in the order in which they are kept if they can be: the last are zero wherever a base parameter can do without them. Mass, first
#: and second moment along the axis are always grouped with those of the link before; the others compete.
_ORDERS = (
    ("Sxy", "Sxz", "Syz", "Sxx", "Syy", "mx", "my", "Szz", "mz", "m"),
    ("mx", "my", "Sxx", "Syy", "Sxy", "Sxz", "Syz", "Szz", "mz", "m"),
    ("m", "mx", "my", "mz", "Sxx", "Syy", "Sxy", "Sxz", "Syz", "Szz"),
)
#: A column that is left with less than this share of itself depends on those kept.
_DEPENDS = 1e-9


@dataclass(frozen=True, eq=False)
class VirtualParameters:
    """Link moments (nb, 10) with the base values of a robot, and the recursive passes with them and with the full set.

    `names` of the moments that are not zero, as in `Sxx_joint2` (second moments of mass, frames turned so that the joint's axis is z)."""

    robot: Robot
    names: tuple[str, ...]
    virtual: RecursivePass
    full: RecursivePass

    @property
    def saving(self) -> float:
        """Share of the operations of the full set's pass that is saved."""
        return 1.0 - self.virtual.operations / self.full.operations

    def torque(self, q: Any, dq: Any, ddq: Any) -> Array:
        """Inverse dynamics of the links (N, n), joint side, at states (N, n) of the independent joints; without drives."""
        robot = self.robot
        q, dq, ddq = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq))
        found = self.virtual.torque(robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq))
        return found @ robot.loop.W

    def to_dict(self) -> dict[str, Any]:
        """For JSON results."""
        counts = {
            key: {"multiplications": one.multiplications, "additions": one.additions}
            for key, one in (("full", self.full), ("virtual", self.virtual))
        }
        return {**counts, "saving": self.saving, "nonzero": list(self.names)}

    def __str__(self) -> str:
        full, virtual = self.full, self.virtual
        return (
            f"recursive Newton-Euler pass: {full.multiplications} multiplications and {full.additions} additions with the full set of"
            f" {10 * full.tree.nb} link parameters, {virtual.multiplications} and {virtual.additions} with {len(self.names)} virtual ones"
            f" ({100 * self.saving:.0f} % saved); sines and cosines not counted"
        )


def virtual_parameters(robot: Robot, base: BaseReduction, base_values: Any) -> VirtualParameters:
    """Give base values back to links so that a pass costs less.

    Parameters
    ----------
    robot : Robot
        On a fixed base.
    base : BaseReduction
        Of its rigid body: `robot.rigid_body().base`.
    base_values : (b,) array
        Values of these base parameters, kg, kg m, kg m².

    Returns
    -------
    VirtualParameters
        Its passes count their operations.

    Raises
    ------
    ConfigurationError
        Values of another number, or a base of more than links.
    UnsupportedError
        A floating base.

    Examples
    --------
    >>> import ident
    >>> from ident.regressor.virtual_parameters import virtual_parameters
    >>> robot = ident.load_robot("puma560")
    >>> base = robot.rigid_body().base
    >>> found = virtual_parameters(robot, base, base.base_values(robot.nominal))
    >>> found.virtual.operations < 0.9 * found.full.operations
    True
    """
    values, frame = np.asarray(base_values, float), aligned(robot.tree)
    nb = frame.tree.nb
    if base.regroup.shape != (len(values), 10 * nb):
        raise ConfigurationError(
            f"virtual parameters need the base of the links alone (robot.rigid_body().base) and its {base.count} values, not {len(values)}."
        )
    # Base values from moments in the aligned frames.
    grouping = np.concatenate([np.linalg.solve(frame.moments[i].T, base.regroup[:, 10 * i : 10 * i + 10].T).T for i in range(nb)], axis=1)
    passes = [_chosen(frame, grouping, values, order, tip) for order, tip in itertools.product(_ORDERS, (True, False))]
    best = min(passes, key=lambda one: one.operations)
    generic = 1.0 + np.random.default_rng(0).uniform(0.1, 0.9, (nb, 10))
    names = tuple(f"{MOMENTS[k]}_{_joint(robot, i)}" for i, k in zip(*np.nonzero(best.moments), strict=True))
    return VirtualParameters(robot, names, best, write_pass(frame.tree, generic))


def _joint(robot: Robot, body: int) -> str:
    return robot.tree_joints[body].name


def _chosen(frame: AlignedTree, grouping: Array, values: Array, order: tuple[str, ...], tip_first: bool) -> RecursivePass:
    """The pass with moments that are kept in an order, links from the tip or from the base."""
    nb = frame.tree.nb
    links = reversed(range(nb)) if tip_first else range(nb)
    kept: list[int] = []
    largest = float(np.abs(grouping).max(initial=0.0))
    basis = np.zeros((len(values), 0))
    for column in (10 * i + MOMENTS.index(symbol) for i in links for symbol in order):
        v = grouping[:, column]
        size = float(np.linalg.norm(v))
        if size <= _DEPENDS * largest or len(kept) == len(values):
            continue
        left = v - basis @ (basis.T @ v)
        left = left - basis @ (basis.T @ left)
        if np.linalg.norm(left) > _DEPENDS * size:
            kept.append(column)
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
    moments = np.zeros(10 * nb)
    moments[kept] = np.linalg.solve(grouping[:, kept], values)
    return write_pass(frame.tree, moments.reshape(nb, 10))
