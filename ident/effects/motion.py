"""Motion: positions, velocities and accelerations on both sides of the transmission, as effects see them."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from ..errors import ConfigurationError
from ..robots.transmission import Side, Transmission

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_T = TypeVar("_T")

#: Largest number of samples times joints for which derivatives are kept with a motion (some tens of megabytes in all).
_REMEMBER = 500_000


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Position, velocity and acceleration, each (N, n), on one side of the transmission.

    `kept`: the direction of motion (N, n), where it is not to follow from `dq` (see `direction`)."""

    q: Array
    dq: Array
    ddq: Array
    kept: Array | None = None

    @cached_property
    def direction(self) -> Array:
        """Sign of the velocity (N, n), 0 at standstill. Effects that jump at a reversal take it from here, not from `dq`:
        derivatives of the prediction hold it constant, because a difference quotient over a jump means nothing."""
        return np.sign(self.dq) if self.kept is None else self.kept

    def of(self, joints: list[int]) -> Coordinates:
        """Of some joints (or motors) only: arrays (N, len(joints))."""
        if joints == list(range(self.q.shape[1])):
            return self
        return Coordinates(self.q[:, joints], self.dq[:, joints], self.ddq[:, joints], self.direction[:, joints])


class Prediction(Protocol):
    """What the model itself predicts along a motion: `ident.effects.reference.Reference` says what each of these is."""

    @property
    def model(self) -> Any: ...

    def of_robot(self, robot: Robot) -> Prediction: ...

    def torque(self, motion: Motion, side: Side | None = None) -> Array: ...

    def load(self, motion: Motion, robot: Robot | None = None) -> Array: ...

    def gravity(self, motion: Motion, gravity: Array) -> Array: ...

    def inertia(self, motion: Motion, direction: Array) -> Array: ...

    def values_of(self, effect: Any, robot: Robot) -> Array: ...

    def sensitivity(self, motion: Motion, direction: Array, *, link_only: bool = False, acting: Side | None = None) -> Array: ...

    def along(
        self,
        motion: Motion,
        direction: Array,
        shift: tuple[Array, Array, Array],
        *,
        link_only: bool = False,
        acting: Side | None = None,
    ) -> Array: ...

    def part(
        self, motion: Motion, side: Side | None = None, robot: Robot | None = None, *, link_only: bool = False, acting: Side | None = None
    ) -> Array: ...


@dataclass(frozen=True, eq=False)
class Motion:
    """N samples of a robot's motion, in time order.

    `t` (N,) s; `joint` and `motor`: the same motion on both sides of the transmission. `load` (N, n), if known: the torque
    that the links ask for on the joint side, as the model predicts it (effects that depend on load must not use the noisy
    measured torque). `torque` (N, n), if known: the measured torque on the measured side. `rate`: samples per second
    where the samples are one uniform run, else 0. `reference`, if known: the model's prediction, for effects that correct
    it. `start`: time of the first sample of the run. `transmission`: what is between the sides. `cutoff_hz`: up to which
    frequency the preparation of the signals let the motion through (inf: it is as it was).

    Examples
    --------
    >>> import ident
    >>> import numpy as np
    >>> robot = ident.load_robot("scara")
    >>> motion = ident.Motion.of(robot, *np.zeros((3, 10, 4)))
    >>> robot.rigid_body().columns(motion).shape
    (10, 4, 40)
    """

    t: Array
    joint: Coordinates
    motor: Coordinates
    load: Array | None = None
    torque: Array | None = None
    rate: float = 0.0
    reference: Prediction | None = None
    start: float = 0.0
    transmission: Transmission | None = None
    cutoff_hz: float = float("inf")

    @classmethod
    def of(
        cls,
        robot: Robot,
        q: Array,
        dq: Array,
        ddq: Array,
        t: Array | None = None,
        *,
        rate: float = 0.0,
        torque: Array | None = None,
        start: float | None = None,
        cutoff_hz: float | None = None,
    ) -> Motion:
        """From joint-side arrays (N, n). Without `t` the samples are unrelated in time (t = 0); without `start` the run
        starts with the first sample."""
        transmission = robot.transmission
        motor = Coordinates(transmission.motor_position(q), transmission.motor_rate(dq), transmission.motor_rate(ddq))
        time = np.zeros(len(q)) if t is None else t
        if start is None:
            start = float(time[0]) if len(time) else 0.0
        cutoff = float("inf") if cutoff_hz is None else cutoff_hz
        return cls(time, Coordinates(q, dq, ddq), motor, None, torque, rate, None, start, transmission, cutoff)

    def __len__(self) -> int:
        return len(self.joint.q)

    def on(self, side: Side) -> Coordinates:
        """The motion on one side."""
        return self.joint if side == Side.JOINT else self.motor

    def with_load(self, load: Array | None) -> Motion:
        """The same motion with the predicted torque of the links (N, n), joint side."""
        return replace(self, load=load)

    def with_reference(self, reference: Prediction) -> Motion:
        """The same motion with the model's prediction, and the load that it predicts."""
        return replace(self, reference=reference, load=reference.load(self))

    def behind(self, transmission: Transmission) -> Motion:
        """The same motion, told what is between its sides if it does not know."""
        return self if self.transmission is not None else replace(self, transmission=transmission)

    def moved(self, robot: Robot, joint: Coordinates) -> Motion:
        """The same samples at other joint coordinates or behind another transmission; directions of motion are kept."""
        transmission = robot.transmission
        rates = transmission.motor_rate(joint.dq), transmission.motor_rate(joint.ddq)
        motor = Coordinates(transmission.motor_position(joint.q), *rates, self.motor.direction)
        joint = replace(joint, kept=self.joint.direction)
        return replace(self, joint=joint, motor=motor, load=None, reference=None, transmission=transmission)

    @property
    def clock(self) -> Array:
        """Seconds (N,) since the start of the run."""
        return self.t - self.start

    @cached_property
    def predicted(self) -> Array:
        """Torque (N, n) on the measured side as the model predicts it, corrections left out (`Reference.torque`)."""
        return self.needed_reference("the predicted torque").torque(self)

    def remembered(self, key: Hashable, compute: Callable[[], _T]) -> _T:
        """The result of `compute`, kept with this motion under `key` where it is small enough: effects whose shape is
        searched ask for the same derivatives again and again."""
        if self.joint.q.size > _REMEMBER:
            return compute()
        if key not in self._memory:
            self._memory[key] = compute()
        return self._memory[key]

    @cached_property
    def _memory(self) -> dict[Hashable, Any]:
        return {}

    def predicted_on(self, side: Side) -> Array:
        """`predicted` carried to a side, (N, n)."""
        reference = self.needed_reference("the predicted torque")
        transmission = reference.model.robot.transmission
        return transmission.torque(self.predicted, transmission.measured, side)

    def measured_on(self, side: Side) -> Array:
        """The measured torque carried to a side, (N, n). Raises ConfigurationError where it is missing."""
        if self.torque is None or self.transmission is None:
            raise ConfigurationError(
                "the measured torque is needed at the full rate, but the motion does not carry it (`Motion.of(torque=...)`)."
            )
        return self.transmission.torque(self.torque, self.transmission.measured, side)

    def needed_reference(self, what: str) -> Prediction:
        """The reference. Raises ConfigurationError where it is missing; `what` needs it."""
        if self.reference is None:
            raise ConfigurationError(
                f"{what} needs the model's own prediction: fit the model first, then `Problem.with_reference(values)`."
            )
        return self.reference

    def needed_load(self, what: str, side: Side) -> Array:
        """The load (N, n) on a side. Raises ConfigurationError where it is missing; `what` needs it."""
        if self.load is None or self.transmission is None:
            raise ConfigurationError(
                f"{what} needs the load as the model predicts it: fit the model first, then `Problem.with_reference(values)`."
            )
        return self.transmission.torque(self.load, Side.JOINT, side)

    def needed_rate(self, what: str) -> float:
        """Samples per second. Raises ConfigurationError where the samples are not one uniform run; `what` needs it."""
        if self.rate <= 0.0 or len(self) < 2:
            raise ConfigurationError(
                f"{what} needs samples that are uniform in time, but the motion has no sampling rate (or is a single sample)."
            )
        return self.rate
