"""From derived runs to signals: masks, the rows' filter, and the report."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence, Sized
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from ..errors import DataError
from ..robots.robot import Robot
from ..robots.transmission import Side
from ..robots.urdf import some
from .cutoff import CutoffChoice
from .filters import RowFilter
from .masks import Standstill, TorqueClipping, find_saturation
from .resample import bridge
from .signals import JointReport, PreparationReport, Signals
from .uniform import Recording, Resampling, UniformRun

Array = np.ndarray
#: A row is not used if more than this share of its filter's weight lies on samples whose torque is missing or cut off.
UNSOUND = 0.02
#: A row is reached by a reversal if more than this share of its weight lies on samples below this multiple of the standstill speed.
TURNING_SHARE = 0.02
TURNING_REACH = 2.0


@dataclass(frozen=True, eq=False)
class Derived:
    """A run with derivatives: `q`, `dq`, `ddq`, `torque` (L, n) from sample `offset` of `run` on."""

    run: UniformRun
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    offset: int

    def __len__(self) -> int:
        return len(self.q)

    def trimmed(self, margin: int) -> Derived:
        """Without so many samples at either end."""
        if margin <= 0:
            return self
        inner = slice(margin, max(margin, len(self) - margin))
        return replace(
            self, q=self.q[inner], dq=self.dq[inner], ddq=self.ddq[inner], torque=self.torque[inner], offset=self.offset + margin
        )

    @property
    def samples(self) -> slice:
        """The samples of `run` that are left."""
        return slice(self.offset, self.offset + len(self))


class Settings(Protocol):
    """A preparation's settings, as far as rows are concerned (`ident.signals.preparation.Preparation` says what each is)."""

    @property
    def cutoff_hz(self) -> float | None: ...

    @property
    def saturated(self) -> str: ...

    @property
    def standstill(self) -> Standstill | None: ...

    @property
    def filters_positions(self) -> bool: ...

    def config(self) -> dict[str, Any]: ...


def assemble(
    prep: Settings,
    robot: Robot,
    recordings: Sequence[Recording],
    uniform: Resampling,
    derived: Sequence[Derived],
    row_filter: RowFilter | None,
    choice: CutoffChoice,
    cutoff: float,
    inputs: tuple[dict[str, str], ...],
) -> Signals:
    """Concatenate runs, mask rows, report. Raises DataError if nothing is left."""
    kept, short = long_enough(derived, max(len(r) for r in uniform.runs), uniform.rate, cutoff, row_filter)
    warnings = [*dict.fromkeys(note for r in recordings for note in r.notes), *short]
    edges = np.cumsum([0, *(len(d) for d in kept)]).tolist()
    runs = tuple(slice(a, b) for a, b in itertools.pairwise(edges))
    t = _joined([d.run.t[d.samples] for d in kept])
    q, dq, ddq = (_joined([getattr(d, k) for d in kept]) for k in ("q", "dq", "ddq"))
    torque = _joined([d.run.torque[d.samples] for d in kept])
    missing = _joined([d.run.missing[d.samples] for d in kept])

    speed = dq if robot.transmission.measured == Side.JOINT else robot.transmission.motor_rate(dq)
    pace = np.abs(speed)
    top = pace.max(axis=0)
    noise = speed_noise(robot, choice, cutoff)
    # Differences of a constant leave only rounding.
    rounding = 100 * np.spacing(np.abs(q).max(axis=0)) * uniform.rate
    if robot.transmission.measured == Side.MOTOR:
        rounding = np.abs(robot.transmission.K_inverse) @ rounding
    still_joint = top <= np.maximum(6 * noise, rounding)
    rule = prep.standstill
    threshold = np.zeros(robot.n) if rule is None else np.where(still_joint, np.inf, rule.thresholds(top, noise))
    moving = pace > np.where(still_joint, np.inf, np.maximum(threshold, 0.01 * top))
    resting = pace <= threshold if rule is not None else np.zeros(speed.shape, bool)
    cut = find_saturation(torque, moving)
    flags = {
        "torque missing": missing,
        "torque at its limit": cut.flag if prep.saturated == "mask" else np.zeros_like(missing),
        "standstill": resting,
    }
    tau_parts, share_parts = [], {k: [] for k in flags}  # type: tuple[list[Array], dict[str, list[Array]]]
    for d, run in zip(kept, runs, strict=True):
        if row_filter is None:
            tau_parts.append(d.torque)
        else:
            tau_parts.append(row_filter.apply(bridge(t[run], d.torque)))
        for k, flag in flags.items():
            part = flag[run]
            share_parts[k].append(part.astype(float) if row_filter is None else filtered_share(row_filter, part))
    tau = np.concatenate(tau_parts)
    shares = {k: np.concatenate(v) for k, v in share_parts.items()}
    allowed = rule.allowed(shares["standstill"]) if rule is not None else np.ones(robot.n)
    lost = {k: share > (allowed if k == "standstill" else UNSOUND) for k, share in shares.items()}
    valid = ~np.logical_or.reduce(list(lost.values()))
    turning = None
    if rule is not None:
        near = pace <= TURNING_REACH * threshold
        reached = [near[run].astype(float) if row_filter is None else filtered_share(row_filter, near[run]) for run in runs]
        turning = np.concatenate(reached) > TURNING_SHARE
    tau[lost["torque missing"]] = np.nan
    absent = np.all([np.isnan(r.torque).all(axis=0) for r in recordings], axis=0)
    warnings += preparation_warnings(robot, still_joint, absent, rule is not None, cut, prep.saturated, valid, lost)
    warnings += raised_shares(robot, rule, allowed)
    warnings += [
        f"the position of {name} is so noisy, or jumps so far, that its accelerations could be had only with a cut-off that leaves nothing"
        f" of the log; the cut-off of {cutoff:.3g} Hz suits the other joints, and what is fitted from {name}'s motion is not to be trusted."
        for name in (choice.unheard if prep.cutoff_hz is None else ())
    ]
    require_motion(rule, still_joint, [r.name for r in recordings])
    joints = tuple(
        JointReport(
            s.name,
            s.noise,
            s.suggested_hz,
            float(top[j]),
            float(threshold[j]),
            int(valid[:, j].sum()),
            {k: int(v[:, j].sum()) for k, v in lost.items()},
        )
        for j, s in enumerate(choice.joints)
    )
    report = PreparationReport(
        config=prep.config(),
        cutoff_hz=cutoff if prep.filters_positions else None,
        cutoff_reason=choice.reason if prep.cutoff_hz is None else f"as asked; from the data {choice.cutoff_hz:.3g} Hz: {choice.reason}",
        row_cutoff_hz=None if row_filter is None else half_gain(row_filter, uniform.rate),
        rate_hz=uniform.rate,
        row_rate_hz=uniform.rate / (row_filter.factor if row_filter else 1),
        samples_read=sum(len(r.t) for r in recordings),
        samples=len(t),
        rows=len(tau),
        resampled=uniform.text,
        joints=joints,
        warnings=tuple(dict.fromkeys(warnings)),
    )
    names = tuple(d.run.name for d in kept)
    origins = tuple(d.run.origin for d in kept)
    return Signals(
        robot, t, q, dq, ddq, torque, tau, valid, runs, names, uniform.rate, row_filter, report, inputs, origins, turning=turning
    )


class _Run(Sized, Protocol):
    """A stretch of a log."""

    @property
    def name(self) -> str: ...


class _HasRun(Protocol):
    """A run with derivatives, as long as what is left of `run`."""

    @property
    def run(self) -> _Run: ...

    def __len__(self) -> int: ...


_D = TypeVar("_D", bound=_HasRun)


def long_enough(
    derived: Sequence[_D], longest: int, rate: float, cutoff: float, row_filter: RowFilter | None
) -> tuple[list[_D], list[str]]:
    """Those runs that the rows' filter fits into, and a warning of the others. `longest`: samples of the longest run at `rate` (Hz).

    Raises DataError if none is left."""
    need = len(row_filter.taps) if row_filter else 1
    kept = [d for d in derived if len(d) >= need]
    if not kept:
        # Transients at both ends (measured where something was left between them), and the length of the rows' filter.
        ends = max((len(d.run) - len(d) for d in derived if len(d)), default=math.ceil(6 / cutoff * rate))
        raise DataError(
            f"{of_logs([d.run.name for d in derived])}: the longest run without a gap lasts {longest / rate:.3g} s: too short for a"
            f" cut-off of {cutoff:.3g} Hz, whose filters need about {(ends + need) / rate:.2g} s. Record longer runs, or raise cutoff_hz."
        )
    left_out = len(derived) - len(kept)
    return kept, [f"{left_out} of {len(derived)} stretches are shorter than the filters and are left out."] if left_out else []


def raised_shares(robot: Robot, rule: Standstill | None, allowed: Array) -> list[str]:
    """What to say where the share of standstill that a row may hold, `allowed` (n,), was raised beyond the rule's."""
    raised = [f"{name} {allowed[j]:.0%}" for j, name in enumerate(robot.joint_names) if rule is not None and allowed[j] > rule.share]
    if not raised:
        return []
    text = (
        "reversals follow each other closely for this cut-off; to keep enough rows, some that rest on standstill in part are used"
        f" ({', '.join(raised)} of their weight at most). Coulomb friction may be off by a few per cent;"
        " a higher cut-off shortens the rows."
    )
    return [text]


def of_logs(names: Sequence[str]) -> str:
    """The logs that a message is about."""
    names = list(dict.fromkeys(names))
    return f"log{'s' * (len(names) > 1)} {some(names)}"


def require_motion(rule: Standstill | None, still: Array, names: Sequence[str]) -> None:
    """Raises DataError where no joint moves (`still` (n,) bool) in the logs of these names, and that is looked for."""
    if rule is not None and still.all():
        raise DataError(
            f"{of_logs(names)}: no joint moves: every speed stays within the noise of its position. There is nothing to identify a"
            " motion's model from."
            " For logs of standstill alone, prepare them with standstill = false."
        )


def _joined(parts: list[Array]) -> Array:
    """Runs one after the other; a single one is not copied."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def filtered_share(row_filter: RowFilter, flag: Array) -> Array:
    """Share of the row filter's weight on flagged samples (L, n) → (M, n)."""
    if not flag.any():
        return np.zeros((row_filter.count(len(flag)), flag.shape[1]))
    return row_filter.magnitude.apply(flag)


def speed_noise(robot: Robot, choice: CutoffChoice, cutoff: float) -> Array:
    """Standard deviation (n,) of the speed's noise on the measured side, behind the low-pass."""
    joint = np.array([s.velocity_noise(cutoff) for s in choice.joints])
    if robot.transmission.measured == Side.JOINT:
        return joint
    return np.sqrt(robot.transmission.K_inverse**2 @ joint**2)


def half_gain(row_filter: RowFilter, rate: float) -> float:
    """Frequency at which the row filter's gain is one half, Hz."""
    low, high = 0.0, rate / 2
    f = np.linspace(low, high, 2 * (len(row_filter.taps) // 8) + 9)
    # Bracketed on a grid that no lobe of the filter escapes, then halved.
    for start in range(0, len(f), 64):
        below = np.flatnonzero(row_filter.gain(f[start : start + 64], rate) < 0.5)
        if len(below):
            high = float(f[start + below[0]])
            low = float(f[max(0, start + below[0] - 1)])
            break
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if row_filter.gain(np.array([middle]), rate)[0] < 0.5 else (middle, high)
    return high


def preparation_warnings(
    robot: Robot, still: Array, absent: Array, masked: bool, cut: TorqueClipping, saturated: str, valid: Array, lost: dict[str, Array]
) -> list[str]:
    """What to say of joints. `still`, `absent` (n,) bool: that never move, whose torque was not logged at all."""
    out = []
    if still.any():
        names = ", ".join(n for n, s in zip(robot.joint_names, still, strict=True) if s)
        what = "its rows are left out" if still.sum() == 1 else "their rows are left out"
        out.append(f"never moved: {names}" + (f"; {what}, and friction and inertia there stay unknown." if masked else "."))
    for j, name in enumerate(robot.joint_names):
        if np.isfinite(cut.limits[j]).any():
            at = " and ".join(f"{x:.4g}" for x in cut.limits[j] if np.isfinite(x))
            use = "left out" if saturated == "mask" else "kept, as asked"
            out.append(
                f"torque of {name} stays at its extreme ({at}) in {int(cut.flag[:, j].sum())} samples: taken as saturated, rows {use}."
            )
        rest = float(lost["standstill"][:, j].mean()) if len(valid) else 0.0
        if not still[j] and rest > 0.5:
            out.append(f"{rest:.0%} of the rows of {name} rest on standstill or reversals; they are left out.")
        if len(valid) and not valid[:, j].any() and not still[j] and not absent[j]:
            sparse = lost["torque missing"][:, j].all()
            out.append(
                f"no row of {name} can be used"
                + (
                    ": its torque is missing in so many samples that every row rests on one. If it is logged more slowly than the"
                    " positions, log it as often, or leave out the lines without it."
                    if sparse
                    else "."
                )
            )
    return out
