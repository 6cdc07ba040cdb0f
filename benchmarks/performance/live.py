"""One sample at a time, as a control loop calls: recursion, feedforward and forward dynamics, each against its peer called from Python."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pinocchio as pin

from ident.estimate.feedforward import FixedModel
from ident.estimators import RecursiveLeastSquares

from .limits import Limit
from .make_large_log import Puma
from .table import Row
from .timing import Work, together

Array = np.ndarray

#: Samples that are taken in turn.
_SAMPLES = 2000


def live_rows(calls: int) -> tuple[list[Row], list[dict[str, Any]]]:
    """A live sample into the recursion (jitter over so many calls), feedforward and forward dynamics of one state of the PUMA; and the
    histogram of the time of single calls."""
    puma = Puma(1)
    q, dq, ddq, tau = puma.motion(np.arange(_SAMPLES) / 200.0)
    live = RecursiveLeastSquares(noise_std=tuple(puma.noise)).start(puma.model).live()
    fixed, model = FixedModel(puma.model, puma.values), puma.robot.model
    data = model.createData()
    torque = fixed.torque(q, dq, ddq)

    def each(call: Any, *arrays: Any) -> Work:
        states = [tuple(x[i] for x in arrays) for i in range(500)]
        return Work(lambda: [call(*state) for state in states], len(states))

    found = together(
        {
            "add": each(live.add, q, dq, ddq, tau),
            "state": Work(lambda: live.state, 1),
            "rows": each(live._fast._rows.add, q, dq, ddq, tau, np.zeros((_SAMPLES, len(live._fast._extra))), [None] * _SAMPLES),  # type: ignore[union-attr]
            "feedforward": each(fixed.torque, q, dq, ddq),
            "rnea": each(lambda a, b, c: pin.rnea(model, data, a, b, c), q, dq, ddq),
            "forward": each(fixed.acceleration, q, dq, torque),
            "aba": each(lambda a, b, c: pin.aba(model, data, a, b, c), q, dq, torque),
            "nothing": each(lambda a, b, c: None, q, dq, ddq),
        }
    )
    several = fixed.torque(q, dq, ddq)
    batch = together({"": Work(lambda: fixed.torque(q, dq, ddq), _SAMPLES)})[""]
    gap = float(np.abs(several - np.array([fixed.torque(*state) for state in zip(q, dq, ddq, strict=True)])).max())
    times = call_times(live, (q, dq, ddq, tau), calls)
    call = Limit((("an empty call of Python", found["nothing"]),))
    rotated = Limit((("the compiled rows and rotations alone", found["rows"]),))
    rows = [
        Row(
            "live sample into the recursion, 6 x 52, PUMA", found["add"], "µs", 60.0, why=rotated.why(found["add"], "µs"),
            note=f"its state out: {found['state']:.0f} µs; of {calls} calls by the clock {quantiles(times)}",
        ),
        Row(
            "feedforward of one state, friction and rotors included", found["feedforward"], "µs", 2 * found["rnea"],
            (("pin.rnea called from Python", found["rnea"], None),), call.why(found["feedforward"], "µs"),
            f"in a batch {batch:.3g} µs; one by one and in a batch equal to {gap:.1g} N m",
        ),
        Row(
            "forward dynamics of one state, friction and rotors included", found["forward"], "µs", 2 * found["aba"],
            (("pin.aba called from Python", found["aba"], None),), call.why(found["forward"], "µs"),
        ),
    ]  # fmt: skip
    return rows, histogram(times)


def call_times(live: Any, arrays: tuple[Any, ...], calls: int) -> Array:
    """Seconds by the clock of single calls of `live.add`."""
    states = [tuple(x[i] for x in arrays) for i in range(_SAMPLES)]
    times = np.empty(calls)
    clock = time.perf_counter
    for k in range(calls):
        state = states[k % _SAMPLES]
        start = clock()
        live.add(*state)
        times[k] = clock() - start
    return times


def quantiles(times: Array) -> str:
    """Quantiles of the time of single calls."""
    shares = (0.5, 0.9, 0.99, 0.999, 1.0)
    parts = [f"{share:.5g} within {value * 1e6:.3g} µs" for share, value in zip(shares, np.quantile(times, shares), strict=True)]
    return ", ".join(parts)


def histogram(times: Array) -> list[dict[str, Any]]:
    """How many calls took how long: bins that grow by half, the first and the last as wide as needed."""
    us = times * 1e6
    edges = np.median(us) * 1.5 ** np.arange(-1, 18)
    counts, _ = np.histogram(np.clip(us, edges[0], edges[-1]), edges)
    last = int(np.flatnonzero(counts)[-1])
    return [
        {"from us": float(edges[k]), "to us": float(edges[k + 1]), "calls": int(counts[k]), "share": float(counts[k] / len(us))}
        for k in range(last + 1)
    ]
