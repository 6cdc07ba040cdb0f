"""What a log of commands holds, before anything is fitted: rate, staircase, repeated readings, resolution, torque off, saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .commands import DriveLog
from .law import DriveLaw

#: Shares below this are not worth a word.
_LITTLE = 0.005
#: An interval between samples that differs from the usual one by less than this share is that of a clock written afterwards.
_IDEAL = 1e-3


@dataclass(frozen=True)
class CommandsSeen:
    """Of one log: samples per second and seconds; shares of samples with an unchanged command, with a repeated position, with torque
    switched off, with a command beyond the effort limit (NaN where the gains are not known); whether the clock is ideal."""

    name: str
    rate_hz: float
    seconds: float
    command_unchanged: float
    position_repeated: float
    torque_off: float
    saturated: float
    ideal_clock: bool

    def text(self) -> str:
        """One line for people."""
        said = [f"log {self.name}: {self.seconds:.3g} s at {self.rate_hz:.4g} Hz"]
        if self.ideal_clock:
            said.append("times exactly equidistant, perhaps written afterwards")
        parts = (
            (self.command_unchanged, "of the commands unchanged from sample to sample (a staircase)"),
            (self.position_repeated, "of the positions repeated while the joint moves"),
            (self.torque_off, "of the time without torque"),
            (self.saturated, "of the commands beyond the effort limit"),
        )
        return ", ".join([*said, *(f"{share:.0%} {what}" for share, what in parts if share > _LITTLE)])


def seen_in(log: DriveLog, law: DriveLaw) -> CommandsSeen:
    """Look at one log."""
    law = law.for_log(log.name)
    step = np.diff(log.t)
    sent = log.tau_ff if law.kind == "voltage" else log.q_cmd if law.sends_positions else log.dq_cmd
    moving = np.abs(np.diff(sent, axis=0)) > 0
    started = np.maximum.accumulate(moving, axis=0)
    still = float(np.mean(~moving[started])) if started.any() else 1.0
    change = np.diff(log.q, axis=0)
    fast = np.abs(change) > 0.3 * np.std(change, axis=0)
    # A repeated reading between two that move.
    between = fast[:-2] & fast[2:]
    repeated = float(np.mean(change[1:-1][between] == 0.0)) if between.any() else 0.0
    asked = np.abs(sent if law.kind == "voltage" else law.constants["kp"] * (log.q_cmd - log.q) + law.constants["kd"] * log.dq_cmd)
    limit = law.constants["effort_limit"]
    known = np.isfinite(asked).all() and not np.isnan(limit).any() and not (law.integrates | law.droops).any()
    known = known and not (law.constants["command_lag_s"].any() or law.deadbands.any())
    ideal = bool(np.ptp(step) < _IDEAL * np.median(step))
    off = float(np.mean(log.enabled < 1.0))
    saturated = float(np.mean(asked > limit)) if known else float("nan")
    return CommandsSeen(log.name, 1.0 / log.period, log.duration, still, repeated, off, saturated, ideal)
