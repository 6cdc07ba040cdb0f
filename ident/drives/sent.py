"""Commands as they act in a drive: after its delay and the first-order filter that smooths them, at instants or as means over steps.

The filter is lag df/dt = c - f, at rest before the first sample. Between two samples its output is known in closed form, at the samples by
a linear recursion, and its mean over a step is that of the command less lag times what the output rises by. Delay and filter commute."""

from __future__ import annotations

import numpy as np

from .given import CommandForm

Array = np.ndarray


def means(t: Array, command: Array, delay: Array, lag: Array, edges: Array, step: Array | float, form: CommandForm) -> Array:
    """Mean (K, n) of a command (N, n) that acts `delay` (n,) later, smoothed by time constants `lag` (n,), between edges (K + 1,).

    `step`: seconds between two edges, one for all or (K,). Ramps are taken at the middle of each step."""
    out = np.empty((len(edges) - 1, command.shape[1]))
    if not np.any(command):
        return np.zeros_like(out)
    held, after = np.concatenate([[0.0], np.diff(t)]), float(np.max(step))
    for j, values in enumerate(command.T):
        if form == CommandForm.RAMP:
            middle = edges[:-1] + 0.5 * step - delay[j]
            out[:, j] = np.interp(middle, t, values) if lag[j] == 0.0 else _smoothed(middle, t, values, lag[j], form)
            continue
        # The integral of a staircase is exact between its corners; before the first sample and after the last it is held.
        time = np.concatenate([[t[0] - 1.0 - delay[j]], t, [t[-1] + 1.0 + after]])
        integral = np.cumsum(held * np.concatenate([[0.0], values[:-1]]))
        total = np.concatenate([[-values[0] * (1.0 + delay[j])], integral, [integral[-1] + values[-1] * (1.0 + after)]])
        out[:, j] = np.diff(np.interp(edges - delay[j], time, total)) / step
        if lag[j] != 0.0:
            out[:, j] -= lag[j] * np.diff(_smoothed(edges - delay[j], t, values, lag[j], form)) / step
    return out


def at_instants(instants: Array, t: Array, command: Array, delay: Array, lag: Array, form: CommandForm) -> Array:
    """A command (N, n) as it acts at instants (K,): (K, n)."""
    out = np.empty((len(instants), command.shape[1]))
    for j, values in enumerate(command.T):
        at = instants - delay[j]
        if lag[j] != 0.0:
            out[:, j] = _smoothed(at, t, values, lag[j], form)
        elif form == CommandForm.RAMP:
            out[:, j] = np.interp(at, t, values)
        else:
            out[:, j] = values[np.clip(np.searchsorted(t, at + 1e-9, side="right") - 1, 0, None)]
    return out


def _smoothed(instants: Array, t: Array, values: Array, lag: float, form: CommandForm) -> Array:
    """Output (K,) of the filter for samples (N,) of a command. A time constant below zero, which a difference about zero asks for, is the
    lead that continues it: the slope without what fades."""
    slope = np.append(np.diff(values) / np.diff(t), 0.0) if form == CommandForm.RAMP else np.zeros(len(t))
    # Where the output goes to from the beginning of each piece on, and how far it is from there; the distance fades.
    towards = values - lag * slope
    jumps = (towards + slope * np.append(np.diff(t), 0.0))[:-1] - towards[1:]
    off = _recursion(_fading(np.diff(t), lag), jumps, values[0] - towards[0] if lag > 0.0 else 0.0)
    piece = np.searchsorted(t, instants, side="left") - 1
    begun, since = np.maximum(piece, 0), np.maximum(instants - t[np.maximum(piece, 0)], 0.0)
    found = towards[begun] + slope[begun] * since + off[begun] * _fading(since, lag)
    return np.where(piece < 0, values[0], found)


def _fading(seconds: Array, lag: float) -> Array:
    return np.exp(-seconds / lag) if lag > 0.0 else np.zeros_like(seconds)


def _recursion(factors: Array, terms: Array, first: float) -> Array:
    """x (N,) with x[i + 1] = factors[i] x[i] + terms[i], by doubling: each pass joins twice as many of the steps."""
    factor, sum_ = np.append(0.0, factors), np.append(first, terms)
    reach = 1
    while reach < len(sum_):
        sum_[reach:] = sum_[reach:] + factor[reach:] * sum_[:-reach]
        factor[reach:] = factor[reach:] * factor[:-reach]
        reach *= 2
    return sum_
