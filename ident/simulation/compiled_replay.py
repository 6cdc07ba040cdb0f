"""Windows of a replay by compiled code: all of them side by side, each under its own torque."""

from __future__ import annotations

import numpy as np

from ..errors import IdentError
from .compiled import CompiledPlant, UnfitError
from .plant import Plant
from .script import Script

Array = np.ndarray


def compiled_windows(
    plant: Plant, t: Array, start: tuple[Array, Array], torque: Array, period: float, substeps: int
) -> tuple[Array, Array, Array]:
    """Replay windows by the compiled integrator, where it knows the plant.

    Parameters
    ----------
    plant : Plant
        The plant, n joints, whose values never change.
    t : (B,) array
        Times at which the windows begin, s.
    start : tuple of (B, n) arrays
        Positions and speeds at these times, joint side.
    torque : (K, B, n) array
        Torque on the measured side, straight between its instants.
    period : float
        Time between instants, s.
    substeps : int
        Integration steps between instants.

    Returns
    -------
    tuple of arrays
        Positions and speeds (K, B, n), joint side, and the windows that the general integrator has to do (places among B): of a plant that
        the compiled one does not know all, else those in which it stops.
    """
    q, dq = np.full((2, *torque.shape), np.nan)
    every = np.arange(len(t))
    compiled = plant.compiled()
    if compiled is None:
        return q, dq, every
    if _ran(compiled, t, start, torque, period, substeps, every, q, dq):
        return q, dq, every[:0]
    # One that stops, stops all beside it.
    left = [i for i in every if not _ran(compiled, t, start, torque, period, substeps, every[i : i + 1], q, dq)]
    return q, dq, np.array(left, int)


def _ran(
    compiled: CompiledPlant,
    t: Array,
    start: tuple[Array, Array],
    torque: Array,
    period: float,
    substeps: int,
    at: Array,
    q: Array,
    dq: Array,
) -> bool:
    """Whether the windows `at` ran to their end; then their motion is put into `q`, `dq`."""
    dynamics = compiled.dynamics
    state = dynamics.start(t[at], start[0][at], start[1][at])
    script = Script(dynamics.robot.transmission.measured, np.ascontiguousarray(torque[:, at]))
    try:
        kept, _, _ = compiled.run(script, state, None, period=period, substeps=substeps, linear=True)
    except (UnfitError, IdentError):
        return False
    q[:, at], dq[:, at] = kept.q, kept.dq
    return True
