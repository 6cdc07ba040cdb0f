"""What is left and follows no quantity: a tone, bursts, or simply more than the noise floor.

The noise floor's colour and level come from the log itself, so that a tone would pass as colour and bursts as a high level: both
are looked for apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .whitening import unwhitened_rows

if TYPE_CHECKING:
    from .stage import Stage

Array = np.ndarray
#: So many rows tell: near reversals many are left out.
_FEW = 40
#: A residual of this many times the noise floor is not noise, whatever it follows.
_BEYOND = 1.3
#: By more than so many standard errors, at that.
_SURELY = 5.0
#: And one whose power is below this share of what counts as noise is nothing, whatever it looks like.
_COUNTS = 0.1
#: Noise has a root mean square of 1.48 times its median size; of so many times that it comes in bursts.
BURSTS = 1.5
#: The same of rows that are not whitened: noise whose colour fades over a tenth of the rows comes to 2.0 once in ten thousand times.
_COLOURED = 2.2
#: So many rows beyond so many standard deviations are bursts as well: noise has one in two million.
_FAR = 5.0
_SEVERAL = 4
#: Rows between one burst and the next.
_APART = 10
#: A line stands so far above the median of its neighbours in the spectrum (chance among a thousand: once in 10⁹), and holds at least
#: this share of all power.
_LINE = 40.0
_SHARE = 0.1
#: Neighbours on each side, and the part of a line's power that a window spreads over them.
_NEAR = 30
_WIDTH = 3


@dataclass(frozen=True)
class Irregular:
    """`evidence`: twice a log-likelihood; `rms`: over the noise's."""

    name: str
    evidence: float
    standard_error: float
    rms: float


def irregular(stage: Stage, joint: int) -> Irregular | None:
    """What is left on a joint's rows that is not noise of one level and a smooth colour; None where nothing is."""
    valid = stage.problem.signals.valid[:, joint]
    residual = stage.frame.residual[joint]
    rows = int(valid.sum())
    if rows < _FEW or float(np.mean(residual[valid] ** 2)) < _COUNTS:
        return None
    raw = unwhitened_rows(stage.white, residual, joint, valid)
    return _line(stage, raw, valid) or _bursts(residual[valid]) or _smooth_bursts(raw[valid]) or _beyond(residual[valid])


def _line(stage: Stage, raw: Array, valid: Array) -> Irregular | None:
    from scipy.ndimage import median_filter

    signals = stage.problem.signals
    rate = signals.rate / (signals.row_filter.factor if signals.row_filter else 1)
    best: tuple[float, float, float] | None = None
    for run in signals.row_runs:
        x = raw[run]
        if len(x) < _FEW:
            continue
        power = np.abs(np.fft.rfft(x * np.hanning(len(x) + 2)[1:-1])) ** 2
        height = power / np.maximum(median_filter(power, 2 * _NEAR + 1), 1e-300)
        height[: _WIDTH + 1] = 0.0
        at = int(np.argmax(height))
        share = float(power[max(0, at - _WIDTH) : at + _WIDTH + 1].sum() / max(power.sum(), 1e-300))
        if height[at] > _LINE and share > _SHARE and (best is None or share > best[1]):
            best = at * rate / len(x), min(share, 1.0 - 1e-9), float(valid[run].sum())
    if best is None:
        return None
    hertz, share, rows = best
    return Irregular(
        f"a tone of {hertz:.3g} Hz", -rows * float(np.log(1.0 - share)), float(np.sqrt(2.0 * rows)), float(np.sqrt(share / (1.0 - share)))
    )


def _bursts(residual: Array) -> Irregular | None:
    squares = over_usual(residual)
    power, far = float(np.mean(squares)), squares > _FAR**2
    if power <= max(BURSTS**2, 1.0 + _SURELY * np.sqrt(2.0 / len(residual))) and int(far.sum()) < _SEVERAL:
        return None
    # What few rows hold may be little beside the noise of all others: it is they that count.
    held = float(squares[far].sum())
    evidence, error = max(
        (len(residual) * (power - 1.0), float(np.sqrt(2.0 * len(residual))) * power), (held, held / np.sqrt(max(1.0, float(far.sum()))))
    )
    return Irregular(_in_bursts(squares), evidence, error, float(np.sqrt(evidence / len(residual))))


def _smooth_bursts(raw: Array) -> Irregular | None:
    """Bursts of so smooth a course, hit so seldom, that a filter takes them for the colour of the noise and its error for the level.

    Rows in a burst are not independent: each burst counts by its highest row."""
    squares = over_usual(raw)
    power, far = float(np.mean(squares)), np.flatnonzero(squares > _FAR**2)
    if power <= _COLOURED**2 or len(far) < _SEVERAL:
        return None
    bursts = np.split(far, np.flatnonzero(np.diff(far) > _APART) + 1)
    heights = np.array([float(squares[burst].max()) for burst in bursts])
    return Irregular(_in_bursts(squares), float(heights.sum()), float(np.sqrt(np.sum(heights**2))), float(np.sqrt(power - 1.0)))


def over_usual(rows: Array) -> Array:
    """Squares of rows over what noise of their median size has: the median of a χ² of one degree of freedom is 0.4549."""
    squares = rows**2
    return np.asarray(squares / max(float(np.median(squares)) / 0.4549, 1e-300))


def _in_bursts(squares: Array) -> str:
    return f"no quantity, but comes in bursts ({100 * float(np.mean(squares > 9.0)):.2g} % of the rows hold most of it)"


def _beyond(residual: Array) -> Irregular | None:
    power = float(np.mean(residual**2))
    if power <= max(_BEYOND**2, 1.0 + _SURELY * np.sqrt(2.0 / len(residual))):
        return None
    name = "no single quantity (with whatever any effect can take up, noise would be less)"
    return Irregular(name, len(residual) * (power - 1.0), float(np.sqrt(2.0 * len(residual)) * power), float(np.sqrt(power - 1.0)))
