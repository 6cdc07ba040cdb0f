"""The result of designing an excitation: the trajectory, and what it will be worth."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import write_atomic
from .._utils.short_repr import ShortRepr
from ..drawing.document import Figure, Section, Table, Text, plain
from ..drawing.shown import Shown
from ..errors import ConfigurationError
from ..simulation.result import write_log_csv
from ..simulation.trajectory import Chained, Trajectory
from .limits import Limits
from .margins import Margin, margin_lines, margins_section
from .objective import chosen_parameters, condition_number
from .pictures import excitation_figure
from .surroundings import Safety, Surroundings
from .view import swept_figure, swept_page

if TYPE_CHECKING:
    import pandas as pd

    from ..effects.motion import Coordinates
    from ..model import Model

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Shown, ShortRepr):
    """An exciting trajectory and the information it gives.

    `information` (b, b): on the base parameters `names`, for one pass sampled at `rate` Hz with white torque noise of std `noise`
    (n,) on the measured side; `value`: the cost function, and of each start in `values`; `shares`: largest share
    of each kind of limit that is used; `margins`: what each joint leaves of the robot's own limits; `safety`: how clear the motion keeps,
    None where collisions were not looked at; `approach`: the way from the present posture, if one was given; `torque_of`: the effects
    whose values predict the torque; `surroundings`: what was to be kept clear of."""

    model: Model = field(repr=False)
    trajectory: Trajectory
    limits: Limits
    rate: float
    noise: Array
    information: Array = field(repr=False)
    value: float
    values: tuple[float, ...]
    shares: Mapping[str, float]
    margins: tuple[Margin, ...] = ()
    safety: Safety | None = None
    approach: Trajectory | None = None
    torque_of: tuple[str, ...] = ()
    surroundings: Surroundings | None = None

    @property
    def whole(self) -> Trajectory:
        """What is run: the approach, if there is one, then the trajectory."""
        return self.trajectory if self.approach is None else Chained((self.approach, self.trajectory))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return self.model.base.names

    @property
    def condition(self) -> float:
        """Condition number of the regressor, rows weighted, columns scaled to equal length."""
        return condition_number(self.information)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (b, b) of the base parameters after one pass."""
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.information), 1e-300))
        half = np.linalg.solve(np.linalg.cholesky(scale[:, None] * self.information * scale), np.diag(scale))
        return half.T @ half

    def expected_std(self, passes: float = 1.0, correlation: float = 1.0) -> Array:
        """Standard deviation (b,) of every base parameter after so many passes. `correlation`: samples after which the noise is
        as good as new (1: white)."""
        return np.sqrt(np.diag(self.covariance) * correlation / passes)

    def seconds_for(self, std: Mapping[str, float], correlation: float = 1.0) -> float:
        """Length of the experiment, s, at which every named base parameter has at most the given standard deviation."""
        if not std:
            raise ConfigurationError("excitation: name at least one base parameter and the accuracy that is wanted.")
        places = chosen_parameters(tuple(std), self.names)
        wanted = np.array(list(std.values()), float)
        if not np.all(wanted > 0):
            raise ConfigurationError("excitation: a wanted standard deviation must be positive.")
        return float(self.trajectory.duration * correlation * np.max(np.diag(self.covariance)[places] / wanted**2))

    def figure(self) -> Figure:
        """Position and speed of each joint between their limits; see `plot`."""
        return excitation_figure(self.model.robot, self.trajectory, self.limits)

    def swept(self) -> Figure:
        """The robot in many postures of the whole motion, from the side, the front and above. Raises ConfigurationError without a URDF."""
        return swept_figure(self.model.robot, self.whole, self.surroundings)

    def to_view(self, path: str | Path, *, force: bool = False) -> Path:
        """Write a page that shows the robot along the whole motion in three dimensions: to turn, and to play."""
        return write_atomic(Path(path), swept_page(self.model.robot, self.whole, self.surroundings), force=force)

    def to_frame(self) -> pd.DataFrame:
        """The motion, approach included, at `rate`: `t`, `q1` …, `dq1` …, `ddq1` …, joint side, SI."""
        import pandas as pd

        t, motion = self._sampled()
        parts = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}
        return pd.DataFrame({"t": t} | {f"{key}{j + 1}": own for key, values in parts.items() for j, own in enumerate(values.T)})

    def sections(self) -> tuple[Section, ...]:
        """What it uses of the limits, and the accuracy to expect."""
        base, std = self.model.base, self.expected_std()
        rows = tuple(
            (name, text, plain(float(std[i])), base.parameters[base.independent[i]].unit)
            for i, (name, text) in enumerate(zip(base.names, base.expressions, strict=True))
        )
        used = tuple(f"{kind}: {100 * share:.1f} % of its limit at most" for kind, share in self.shares.items())
        safe = ("NOT checked: collisions of any kind, the ground among them",) if self.safety is None else tuple(self.safety.lines())
        head = ("parameter", "base-parameter expression", "expected std", "unit")
        title = f"Excitation of {self.trajectory.duration:g} s"
        used += tuple(self._torque_lines())
        parts = Text(title, used), Text("Clearance", safe), margins_section(self.margins)
        swept = (self.swept(),) if "urdf_text" in self.model.robot.source else ()
        return *parts, Table("Accuracy to expect", head, rows, left=2), *swept

    def _sampled(self) -> tuple[Array, Coordinates]:
        """Times (N,) at `rate` and the whole motion there; its last sample is at rest at its end."""
        whole = self.whole
        t = np.arange(int(np.ceil(whole.duration * self.rate - 1e-9)) + 1) / self.rate
        return t, whole.sample(t)

    def to_csv(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the motion, approach included, at `rate`: `t`, `q1` …, `dq1` …, `ddq1` …, joint side, SI."""
        t, motion = self._sampled()
        return write_log_csv(path, t, {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}, force=force)

    def to_ros(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the motion, approach included, at `rate` as a ROS 2 `trajectory_msgs/msg/JointTrajectory` in YAML, for `ros2 topic pub` or
        an action."""
        names = ", ".join(json.dumps(name) for name in self.model.robot.joint_names)
        lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''", f"joint_names: [{names}]", "points:"]
        t, motion = self._sampled()
        for i, at in enumerate(t):
            nanoseconds = round(float(at) * 1e9)
            for mark, key, values in (("-", "positions", motion.q), (" ", "velocities", motion.dq), (" ", "accelerations", motion.ddq)):
                lines.append(f"{mark} {key}: [{', '.join(repr(float(x)) for x in values[i])}]")
            lines.append(f"  time_from_start: {{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}")
        return write_atomic(Path(path), "\n".join(lines) + "\n", force=force)

    def to_dict(self, values: Array | None = None) -> dict[str, Any]:
        """JSON form. `values` (k,): parameters from which relative standard deviations are told."""
        base = self.model.base
        std = self.expected_std()
        sizes = [None] * len(std) if values is None else np.abs(base.base_values(values)).tolist()
        rows = []
        for i, (name, expression) in enumerate(zip(base.names, base.expressions, strict=True)):
            unit = base.parameters[base.independent[i]].unit
            row: dict[str, Any] = {"name": name, "expression": expression, "unit": unit, "expected_std": float(std[i])}
            if sizes[i]:
                row["expected_relative_std"] = float(std[i] / sizes[i])
            rows.append(row)
        return {
            "duration_s": self.trajectory.duration,
            "rate_hz": self.rate,
            "noise": self.noise.tolist(),
            "condition": self.condition,
            "value": self.value,
            "values_of_starts": list(self.values),
            "share_of_limits": dict(self.shares),
            "margins": [m.to_dict() for m in self.margins],
            "safety": None if self.safety is None else self.safety.to_dict(),
            "start": self.trajectory.sample(np.zeros(1)).q[0].tolist(),
            "approach_s": 0.0 if self.approach is None else self.approach.duration,
            "torque_predicted_by": list(self.torque_of),
            "parameters": rows,
        }

    def _torque_lines(self) -> list[str]:
        """What the torque is predicted from, and what is missing in it."""
        absent = [e.name for e in self.model.effects if e.name not in self.torque_of]
        if not self.torque_of:
            return ["NOT checked: torque; no parameter values are known (a saved fit, --fit, has them)"]
        more = f"; NOT in it, no value is known: {', '.join(absent)} (a saved fit, --fit, has them)" if absent else ""
        return [f"torque as predicted from: {', '.join(self.torque_of)}{more}"]

    def __str__(self) -> str:
        base, std = self.model.base, self.expected_std()
        width = max(len(name) for name in base.names)
        used = ", ".join(f"{kind} {100 * share:.1f} %" for kind, share in self.shares.items())
        head = f"excitation of {self.trajectory.duration:g} s, {base.count} base parameters, condition {self.condition:.3g};"
        noise = ", ".join(f"{x:.3g}" for x in self.noise)
        lines = [f"{head} of the limits it uses: {used}", f"expected accuracy at a torque noise (std of each sample) of {noise}:"]
        for i, (name, text) in enumerate(zip(base.names, base.expressions, strict=True)):
            lines.append(f"  {name:<{width}}  ± {std[i]:9.3g} {base.parameters[base.independent[i]].unit:<8} {text}")
        start = ", ".join(f"{x:.3f}" for x in self.trajectory.sample(np.zeros(1)).q[0])
        lines += [*margin_lines(self.margins), *self._torque_lines(), f"starts and ends at rest at ({start})"]
        if self.approach is not None:
            lines.append(f"before it, an approach of {self.approach.duration:.1f} s from the present posture")
        lines += ["NOT checked: collisions of any kind, the ground among them"] if self.safety is None else self.safety.lines()
        return "\n".join(lines)
