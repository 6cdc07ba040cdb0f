"""Generic shapes: smooth functions of one or two quantities on a motor's row, whatever law is behind them. They tell that something is
left, and what it follows; they are never named as a cause."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...effects.motion import Motion

Array = np.ndarray


def hats(x: Array, count: int) -> Array:
    """Linear hat functions (N, count) over the usual range of x (N,)."""
    low, high = np.quantile(x, [0.002, 0.998])
    u = np.clip((x - low) / max(high - low, 1e-12), 0.0, 1.0) * (count - 1)
    return np.maximum(0.0, 1.0 - np.abs(u[:, None] - np.arange(count)))


#: Waves along a joint's travel in which friction varies a little: up to 32 periods, as of teeth and rollers that a joint passes.
_WAVES = 64


def waves(motions: list[Motion], speeds: Array) -> Iterator[tuple[int, list[Array]]]:
    """Motors with columns (N, k) for each run: the direction of motion times waves along the joint's travel."""
    edges = np.cumsum([0, *map(len, motions)])[1:-1]
    for j in np.flatnonzero(speeds > 0).tolist():
        q = np.concatenate([m.joint.q[:, j] for m in motions])
        w = np.concatenate([m.motor.dq[:, j] for m in motions])
        low, high = np.quantile(q, [0.002, 0.998])
        along = np.clip((q - low) / max(high - low, 1e-12), 0.0, 1.0)[:, None] * np.pi * np.arange(1, _WAVES + 1)
        yield j, np.split(np.tanh(w / (speeds[j] / 250.0))[:, None] * np.cos(along), edges)


#: Seconds after an event over which its answer is looked at.
_AFTER = (0.0, 0.03, 0.06, 0.1, 0.16, 0.25, 0.4, 0.65)


def since(x: Array, clock: Array) -> Array:
    """Hat functions (N, k) of the time since x (N,) last changed its sign, signed by its new sign: what answers such an event."""
    sign = np.where(x >= 0.0, 1.0, -1.0)
    at = np.flatnonzero(np.diff(sign) != 0) + 1
    last = np.zeros(len(x), int)
    last[at] = at
    last = np.maximum.accumulate(last)
    passed = np.where(last > 0, clock - clock[last], np.inf)
    nodes = np.array(_AFTER)
    out = np.zeros((len(x), len(nodes) - 1))
    for k in range(len(nodes) - 1):
        left = nodes[k - 1] if k else -1.0
        rise = np.clip((passed - left) / (nodes[k] - left), 0.0, 1.0)
        fall = np.clip((nodes[k + 1] - passed) / (nodes[k + 1] - nodes[k]), 0.0, 1.0)
        out[:, k] = np.where(np.isfinite(passed), np.minimum(rise, fall) if k else np.where(passed < 0, 0.0, fall), 0.0)
    return out * sign[:, None]


def shapes(motions: list[Motion], speeds: Array) -> Iterator[tuple[str, int, list[Array]]]:
    """What the structure follows, the motor, and columns (N, k) for each run. `speeds` (n,): usual speeds of the motors."""
    n = motions[0].joint.q.shape[1]
    edges = np.cumsum([0, *map(len, motions)])[1:-1]

    def split(columns: Array) -> list[Array]:
        return np.split(columns, edges)

    q = np.concatenate([m.joint.q for m in motions])
    w = np.concatenate([m.motor.dq for m in motions])
    time = np.concatenate([m.clock for m in motions])
    load = None if motions[0].load is None else np.concatenate([m.load for m in motions if m.load is not None])
    for j in range(n):
        if speeds[j] <= 0:
            continue
        s = np.tanh(w[:, j] / (speeds[j] / 250.0))[:, None]
        centred = q[:, j] - q[:, j].mean()
        yield "position", j, split(hats(q[:, j], 8))
        yield "position and direction of motion", j, split(s * hats(q[:, j], 8))
        yield "speed", j, split(hats(np.tanh(w[:, j] / (0.5 * speeds[j])), 10))
        yield "time since its velocity reversed", j, [since(m.motor.dq[:, j], m.clock) for m in motions]
        if load is not None:
            yield "time since its load reversed", j, [since(m.load[:, j], m.clock) for m in motions if m.load is not None]
        yield "time", j, split(hats(time, 8))
        yield "time and direction of motion", j, split(s * hats(time, 6))
        if load is not None:
            yield "load", j, split(hats(load[:, j], 8))
            yield "load and direction of motion", j, split(s * hats(load[:, j], 6))
        for i in range(n):
            if i != j and speeds[i] > 0:
                other = np.abs(w[:, i])
                both = np.stack([other, np.tanh(other / (0.1 * speeds[i]))], axis=1)
                yield f"speed of joint {i + 1}", j, split(both * np.sign(w[:, [i]]))
                yield f"speed of joint {i + 1} and direction of motion", j, split(s * both)
                yield f"position of joint {i + 1} and direction of motion", j, split(s * hats(q[:, i], 5))
                around = np.stack([np.sin(q[:, i]), np.cos(q[:, i])], axis=1)
                yield f"position with that of joint {i + 1}", j, split(np.concatenate([centred[:, None] * around, around], axis=1))
