"""Before estimating: rank, condition, base parameters, and what the motion in the log can reveal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.text import WIDTH, shortened
from ..regressor.base_parameters.reduction import BaseReduction
from ..statistics.torque_error import number
from .advice import advice
from .agreement import agreement
from .linear_solution import order_of, row_variances, solve_triangle

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .agreement import Agreement
    from .information import Information

Array = np.ndarray
#: A parameter is called poorly excited when its std, for noise of one hundredth of the joint's torque, exceeds this share of its size.
_POOR = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class ProblemCheck(ShortRepr):
    """What a problem can determine.

    `base`: base parameters of the structure; `rank`: how many of them these data determine; `condition` of the scaled
    regressor; `inflation` (b,): by how much each parameter's std exceeds that of fitting it alone (collinearity); `agreement`
    of closed forms, structure and samples on the links' base parameters;
    `expected_relative_std` (b,): std over size after a plain fit; `poor`: names; `notes`."""

    base: BaseReduction
    rank: int
    condition: float
    inflation: Array
    expected_relative_std: Array
    poor: tuple[str, ...]
    advice: tuple[str, ...]
    rows: Array
    agreement: Agreement
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "structural_rank": self.base.count,
            "rank": self.rank,
            "condition": number(self.condition),
            "rows": [int(r) for r in self.rows],
            "agreement": self.agreement.to_dict(),
            "parameters": [
                {"name": n, "expression": e, "inflation": number(i), "expected_relative_std": number(s)}
                for n, e, i, s in zip(self.base.names, self.base.expressions, self.inflation, self.expected_relative_std, strict=True)
            ],
            "poorly_excited": list(self.poor),
            "advice": list(self.advice),
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        kept, dropped = self.base.gap
        lines = [f"{self.base.count} base parameters of {len(self.base.parameters)}; these data determine {self.rank}"]
        lines.append(f"condition {self.condition:.3g} (columns scaled); smallest kept distance {kept:.1e}, largest dropped {dropped:.1e}")
        lines += str(self.agreement).splitlines()

        width = max(len(n) for n in self.base.names)
        for name, text, spread in zip(self.base.names, self.base.expressions, self.expected_relative_std, strict=True):
            mark = "  poorly excited" if name in self.poor else ""
            std = f"±{100 * spread:8.2g} %" if np.isfinite(spread) else "   not seen"
            head = f"  {name:<{width}}  {std}  "
            lines.append(head + shortened(text, WIDTH - len(head) - len(mark)) + mark)
        return "\n".join([*lines, *self.advice, *(f"note: {n}" for n in self.notes)])


def check_problem(robot: Robot, base: BaseReduction, information: Information) -> ProblemCheck:
    """What the information of the samples can determine of the base parameters."""
    from scipy.linalg import solve_triangular

    start = np.where(information.counts > 0, information.counts / np.maximum(information.torque_squares(), 1e-300), 0.0)
    R, z, _ = information.combined(start)
    first = solve_triangle(R, z, order_of(base))
    selected = information.selected(first.columns)
    floor = 1e-12 / np.maximum(start, 1e-300)
    weights = np.where(start > 0, 1.0 / np.maximum(row_variances(selected, first.values), floor), 0.0)
    solution = solve_triangle(*information.combined(weights)[:2], order_of(base))
    inverse = solve_triangular(solution.root, np.eye(len(solution.values)))
    std = np.linalg.norm(inverse, axis=1)
    inflation, relative = np.full(base.count, np.inf), np.full(base.count, np.inf)
    inflation[solution.columns] = std * np.linalg.norm(solution.root, axis=0)
    relative[solution.columns] = std / np.maximum(np.abs(solution.values), 1e-300)
    poor = tuple(n for n, r, i in zip(base.names, relative, inflation, strict=True) if not np.isfinite(r) or (r > _POOR and i > 10))
    notes = list(base.notes)
    for j, joint in enumerate(robot.joints):
        if information.counts[j] == 0:
            notes.append(f"joint {joint.name}: no usable torque row; what only this row shows cannot be estimated.")
    return ProblemCheck(
        base, len(solution.columns), solution.condition, inflation, relative, poor, advice(robot, base, poor),
        information.counts, agreement(robot), tuple(notes),
    )  # fmt: skip
