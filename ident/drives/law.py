"""Drive laws as data: what a drive makes of its commands, each constant known or to be identified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..logs.log import run_of
from ..robots.tables import LAW_CONSTANTS
from .given import FORMS, IDENTIFY, NONE, CommandForm, SupplyForm, VelocityCommand, forms_of, of_a_log, per_joint
from .loads import Load

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..robots.tables import DriveTable

Array = np.ndarray
#: The constants of a law, with what they are where nothing is said: a number, or to be identified.
_GEARED: dict[str, float | str | None] = {
    "gear_loss": 0.0,
    "gear_loss_square": 0.0,
    "gear_loss_slow": 0.0,
    "slow_speed": 1.0,
    "joint_stiffness": np.inf,
    "joint_damping": 0.0,
}
_GEAR: dict[str, float | str | None] = {**_GEARED, "feed_forward": 1.0, "command_lag_s": 0.0}
_DEFAULTS: dict[str, dict[str, float | str | None]] = {
    "pd_position": {"kp": None, "kd": 0.0, "delay_s": IDENTIFY, "effort_limit": np.inf, "torque_scale": 1.0, "back_emf": 0.0, **_GEAR},
    "pd_velocity": {"kp": 0.0, "kd": None, "delay_s": IDENTIFY, "effort_limit": np.inf, "torque_scale": 1.0, "back_emf": 0.0, **_GEAR},
    "pwm": {"kp": None, "kd": 0.0, "delay_s": IDENTIFY, "effort_limit": 1.0, "torque_scale": IDENTIFY, "back_emf": IDENTIFY, **_GEAR},
    "voltage": {"delay_s": IDENTIFY, "effort_limit": np.inf, "torque_scale": IDENTIFY, "back_emf": IDENTIFY, **_GEARED},
}  # fmt: skip
for _kind in ("pd_position", "pd_velocity"):
    _DEFAULTS[_kind]["no_load_speed"] = np.inf
for _kind in ("pd_position", "pwm"):
    _DEFAULTS[_kind]["deadband"] = 0.0
_DEFAULTS["pid_position"] = {**_DEFAULTS["pd_position"], "ki": None, "integral_start": IDENTIFY}
#: What a law has no place for, and with which it is the general one.
_NO_INTEGRAL = {"ki": 0.0, "integral_start": 0.0}
_FIXED: dict[str, dict[str, float]] = {
    "pd_position": _NO_INTEGRAL,
    "pd_velocity": {"deadband": 0.0, **_NO_INTEGRAL},
    "pwm": {"no_load_speed": np.inf, **_NO_INTEGRAL},
    "voltage": {"kp": 0.0, "kd": 0.0, "feed_forward": 1.0, "command_lag_s": 0.0, "deadband": 0.0, "no_load_speed": np.inf, **_NO_INTEGRAL},
}
#: Constants of which "identify" means one number for all joints.
SHARED = ("delay_s", "command_lag_s")
#: Laws whose logs hold a torque or a current.
MEASURED = ("torque", "current")


#: What `[drive]` says of a law, as `DriveLaw.of` takes it.
_KEYS = (*LAW_CONSTANTS, *FORMS)


@dataclass(frozen=True, eq=False)
class DriveLaw:
    """τ = s (kp (q_cmd(t − d) − q) + kd (dq_cmd(t − d) − dq) + z + f tau_ff(t − d)) − back_emf dq, the bracket within ±effort_limit.

    With `command_lag_s` T, q_cmd and dq_cmd here are what a first-order filter makes of the logged ones, T dy/dt = q_cmd − y, at rest
    where a log begins; tau_ff is added behind it. With `deadband` b, an error of position counts by what it is beyond ±b.

    z, the integral part, is that of law "pid_position": dz/dt = ki (q_cmd(t − d) − q). It stands still while the limit holds and the
    error would wind it further, and is zero while the drive is switched off. With other laws it is zero.

    Parameters
    ----------
    kind : str
        "pd_position" (s is `torque_scale`, 1 by default), "pid_position", "pd_velocity" (kp = 0), "pwm": the bracket is a share of full
        voltage, s is the supply voltage times `torque_scale` (torque constant over resistance), kp in 1/rad; or "voltage": the bracket
        is the voltage u(t − d) that the drive was sent, within ±effort_limit (V), s is `torque_scale`.
    constants : mapping
        "kp" (N m/rad), "kd" (N m s/rad), "delay_s", "command_lag_s" (s), "deadband" (rad; both 0 by default), "effort_limit" (N m),
        "torque_scale" (1; pwm, voltage: N m/V), "back_emf" (N m s/rad) → (n,), NaN where the constant is to be identified, infinite where
        there is none ("none": of effort_limit, joint_stiffness, no_load_speed). What a gear
        loses of the drive's torque τ, as dry friction: `gear_loss` |τ|, `gear_loss_square` τ², `gear_loss_slow`
        |τ| exp(−(dq/`slow_speed`)²); 0 by default. `joint_stiffness` (N m/rad), `joint_damping`: a spring between motor and link, the
        encoder on the motor; none by default. `feed_forward` f: the share of the logged tau_ff that reaches the drive, 1 by default; 0 in
        a log whose tau_ff was planned and not sent. "pid_position" has
        "ki" (N m/(rad s)) and "integral_start": z (N m) where a recording begins, 0 where the drive is switched on there, of each log by
        itself where it is to be identified. `no_load_speed` v0 (rad/s; none by default, not with a voltage, which falls by back-EMF): along
        the motion the limit is effort_limit (1 − |dq| / v0), which brakes beyond v0; against it, effort_limit.
    shared : frozenset of str
        Constants to be identified as one number for all joints: delay_s, command_lag_s, where they are "identify" as a whole.
    command, velocity_command
        What happens between the logged commands, and beside them.
    supply
        The voltage under "pwm".
    links_known : bool
        Whether the inertials of the robot's links are known.
    by_log : mapping
        Name of a log or pattern → what differs in that log.
    only_by_log : frozenset of str
        Constants that the law itself has no word of, and every entry of `by_log` a number.
    load : Load, optional
        A known body that a link carries beside its own: of the law of one log, by its `load` in `by_log`.

    Examples
    --------
    >>> import ident
    >>> from ident.drives import DriveLaw
    >>> robot = ident.load_robot("scara", transmission=[1.0, 1.0, 1.0, 1.0])
    >>> law = DriveLaw.of(robot, kp=20.0, kd=1.0)
    >>> law.unknown("delay_s"), law.unknown("kp")
    (True, False)
    """

    kind: str
    constants: Mapping[str, Array]
    shared: frozenset[str] = frozenset()
    command: CommandForm = CommandForm.STAIRCASE
    velocity_command: VelocityCommand = VelocityCommand.LOGGED
    supply: SupplyForm = SupplyForm.LOGGED
    links_known: bool = True
    by_log: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    joints: tuple[str, ...] = ()
    only_by_log: frozenset[str] = frozenset()
    load: Load | None = None

    @classmethod
    def of(cls, robot: Robot, kind: str = "pd_position", *, links: str = "known", by_log: Any = None, **given: Any) -> DriveLaw:
        """From numbers, lists or tables by joint, as a study file has them. Raises ConfigurationError, UnsupportedError."""
        if kind not in _DEFAULTS:
            raise unknown_name("[drive] law", kind, (*_DEFAULTS, *MEASURED))
        if not robot.transmission.is_diagonal:
            raise UnsupportedError(
                "[drive] law: each drive acts on one joint, and K couples joints. Log commands and positions of the joints, and give one"
                " ratio for each ([drive] ratio = [1, …] for constants of rotors and friction at the joints), or fit to a measured torque."
            )
        forms = {key: given.pop(key) for key in FORMS if given.get(key) is not None}
        given = {key: value for key, value in given.items() if value is not None}
        constants, shared = {}, set()
        per_log = list((by_log or {}).values())
        open_ = {key for key in _DEFAULTS[kind] if key not in given and per_log and all(key in table for table in per_log)}
        for key, default in _DEFAULTS[kind].items():
            value = given.pop(key, default)
            if value is None and not all(key in table for table in per_log or [{}]):
                raise ConfigurationError(f'[drive] law {kind!r} needs {key}: a number, one per joint, or "identify".')
            constants[key] = per_joint(key, IDENTIFY if value is None else value, robot)
            if key in SHARED and isinstance(value, str):
                shared.add(key)
        if given:
            raise unknown_name(f"constant of [drive] law {kind!r}", min(given), _DEFAULTS[kind])
        for table in per_log:
            if foreign := set(table) & set(_FIXED.get(kind, ())):
                raise unknown_name(f"constant of [drive] law {kind!r}", min(foreign), _DEFAULTS[kind])
        constants |= {key: np.full(robot.n, value) for key, value in _FIXED.get(kind, {}).items()}
        checked = {name: of_a_log(name, table, robot) for name, table in (by_log or {}).items()}
        law = cls(
            kind,
            constants,
            frozenset(shared),
            links_known=links == "known",
            by_log=checked,
            joints=robot.joint_names,
            only_by_log=frozenset(open_),
        )
        law._require_limit()
        return replace(law, **forms_of(forms))

    def _require_limit(self) -> None:
        """Raises ConfigurationError for a limit that falls with speed where there is none, or to nothing at no speed."""
        for constants in (self.constants, *({**self.constants, **table["constants"]} for table in self.by_log.values())):
            none = ~np.isinf(constants["no_load_speed"]) & (np.isinf(constants["effort_limit"]) | (constants["no_load_speed"] == 0.0))
            if none.any() and "effort_limit" not in self.only_by_log:
                raise ConfigurationError(
                    f"[drive] no_load_speed of joint {self.joints[int(np.argmax(none))]!r} says how effort_limit falls with speed: give"
                    " effort_limit too, and a speed above zero."
                )

    @classmethod
    def read(cls, table: DriveTable, robot: Robot) -> DriveLaw | None:
        """The law that a study's `[drive]` declares; None where its logs hold torque or current."""
        given = {key: getattr(table, key) for key in _KEYS}
        if table.law is not None and table.law not in MEASURED:
            return cls.of(robot, table.law, links=table.links or "known", by_log=table.by_log, **given)
        if useless := [key for key, value in given.items() if value is not None]:
            none = "no law is given" if table.law is None else f"law {table.law!r} means a torque that was logged"
            raise ConfigurationError(
                f"[drive] {', '.join(useless)}: constants of a drive law, but {none}. Take them out, or give the law from command to"
                f" torque ({', '.join(_DEFAULTS)})."
            )
        return None

    @property
    def in_volts(self) -> bool:
        """Whether the bracket is a voltage, or a share of one: the torque then grows with `torque_scale`, and with no gain."""
        return self.kind in ("pwm", "voltage")

    @property
    def gain(self) -> str:
        """The constant to which the drive's torque is in proportion: of a drive that is sent speeds, kd."""
        return "kd" if self.kind == "pd_velocity" else "kp"

    @property
    def scales(self) -> tuple[str, ...]:
        """Constants of which any one unknown leaves the scale of all torque open."""
        return (self.gain, "torque_scale")

    @property
    def fixed(self) -> frozenset[str]:
        """Constants of the general law that this kind has no place for."""
        return frozenset(_FIXED.get(self.kind, ()))

    @property
    def droops(self) -> Array:
        """(n,) whether the limit of a joint's drive falls with its speed, or may do so, in some log."""
        tables = [self.constants, *(table["constants"] for table in self.by_log.values())]
        return np.any([~np.isinf(table["no_load_speed"]) for table in tables if "no_load_speed" in table], axis=0)

    @property
    def integrates(self) -> Array:
        """(n,) whether a joint's drive integrates its error, or may do so, in some log."""
        return self._has("ki")

    @property
    def deadbands(self) -> Array:
        """(n,) whether small errors are none to a joint's drive, or may be, in some log."""
        return self._has("deadband")

    def _has(self, key: str) -> Array:
        """(n,) whether a constant is anything but 0 in some log."""
        tables = [self.constants, *(table["constants"] for table in self.by_log.values())]
        return np.any([table[key] != 0.0 for table in tables if key in table], axis=0)

    @property
    def sends_positions(self) -> bool:
        """Whether the drive is sent positions."""
        return self.kind not in ("pd_velocity", "voltage")

    def unknown(self, key: str) -> bool:
        """Whether some joint's constant is to be identified."""
        return bool(np.isnan(self.constants[key]).any())

    @staticmethod
    def of_log(pattern: str, name: str) -> bool:
        """Whether a pattern of `by_log` is that of a log, by its name, or by that of the run that it is a part of."""
        run = run_of(name)
        return pattern in (name, run) or fnmatch(name, pattern) or fnmatch(run, pattern)

    def for_log(self, name: str) -> DriveLaw:
        """The law of one log, by its name, or by that of the run that it is a part of."""
        law = self
        for pattern, table in self.by_log.items():
            if self.of_log(pattern, name):
                load = law.load if table["load"] is None else table["load"]
                law = replace(law, constants={**law.constants, **table["constants"]}, load=load, **table["forms"])
        return law

    @property
    def loaded(self) -> bool:
        """Whether links carry a known body in some log."""
        return any(table["load"] is not None for table in self.by_log.values())

    @property
    def known(self) -> bool:
        """Whether nothing but a delay is to be identified, so that the law yields the torque."""
        return not any(self.unknown(key) for key in self.constants if key != "delay_s")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as `[drive]` has it."""

        def plain(constants: Mapping[str, Array]) -> dict[str, list[Any]]:
            return {k: [IDENTIFY if np.isnan(x) else NONE if np.isinf(x) else float(x) for x in v] for k, v in constants.items()}

        logs: dict[str, Any] = {}
        for name, t in self.by_log.items():
            logs[name] = {**plain(t["constants"]), **{k: str(v) for k, v in t["forms"].items()}}
            if t["load"] is not None:
                logs[name]["load"] = t["load"].to_dict()
        forms = {key: str(getattr(self, key)) for key in FORMS}
        own = {key: values for key, values in self.constants.items() if key not in self.only_by_log | self.fixed}
        return {"law": self.kind, **plain(own), **forms, "links": "known" if self.links_known else IDENTIFY, "by_log": logs}
