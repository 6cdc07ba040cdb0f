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
        yield "time", j, split(hats(time, 8))
        yield "time and direction of motion", j, split(s * hats(time, 6))
        if load is not None:
            yield "load", j, split(hats(load[:, j], 8))
            yield "load and direction of motion", j, split(s * hats(load[:, j], 6))
        for i in range(n):
            if i != j and speeds[i] > 0:
                other = np.abs(w[:, i])
                both = np.stack([other, np.tanh(other / (0.1 * speeds[i]))], axis=1)
                yield f"speed of joint {i + 1} and direction of motion", j, split(s * both)
                yield f"position of joint {i + 1} and direction of motion", j, split(s * hats(q[:, i], 5))
                around = np.stack([np.sin(q[:, i]), np.cos(q[:, i])], axis=1)
                yield f"position beside joint {i + 1}", j, split(np.concatenate([centred[:, None] * around, around], axis=1))
