"""Descent inside limits: quasi-Newton steps on a function that may be infinite outside its domain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Array = np.ndarray


def descend(function: Callable[[Array, bool], tuple[float, Array | None]], x: Array, iterations: int) -> Array:
    """Quasi-Newton descent (BFGS) with backtracking; the function may be inf outside its domain. Returns the best point.

    `function(x, wants_gradient)` gives the value and, if wanted, the gradient."""
    value, gradient = function(x, True)
    if gradient is None:
        return x
    size = len(x)
    H = np.eye(size)
    fresh = True
    for _ in range(iterations):
        assert gradient is not None
        direction = -H @ gradient
        slope = float(gradient @ direction)
        if slope >= 0:
            H, fresh = np.eye(size), True
            direction, slope = -gradient, -float(gradient @ gradient)
        if -slope <= 1e-14 * (1.0 + abs(value)):
            break
        step = min(1.0, 0.2 * float(np.linalg.norm(x)) / float(np.linalg.norm(direction))) if fresh else 1.0
        accepted, trial = False, x
        for _ in range(40):
            trial = x + step * direction
            new, _unused = function(trial, False)
            if new <= value + 1e-4 * step * slope:
                accepted = True
                break
            step *= 0.5
        if not accepted:
            if fresh:
                break
            H, fresh = np.eye(size), True
            continue
        new, next_gradient = function(trial, True)
        if next_gradient is None:
            break
        s, y = trial - x, next_gradient - gradient
        sy = float(s @ y)
        if sy > 1e-12 * float(np.linalg.norm(s) * np.linalg.norm(y)):
            if fresh:
                H *= sy / float(y @ y)
            rho = 1.0 / sy
            Hy = H @ y
            H += (1.0 + rho * float(y @ Hy)) * rho * np.outer(s, s) - rho * (np.outer(Hy, s) + np.outer(s, Hy))
            fresh = False
        small = abs(value - new) <= 1e-9 * (1.0 + abs(value))
        x, value, gradient = trial, new, next_gradient
        if small:
            break
    return x
