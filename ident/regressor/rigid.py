"""Rigid-body dynamics over arrays of samples: torque regressor, inverse and forward dynamics of any tree of joints.

Every function takes a `RigidBodyTree` and arrays whose first axis is the sample. Conventions are Pinocchio's: inertial
parameters per body `m mx my mz Ixx Ixy Iyy Ixz Iyz Izz` about the joint frame's origin; a free-flyer's velocity is linear then
angular, in the body's frame, its position is x y z and the quaternion x y z w. The parameters need not be physical: nothing
divides by a mass. Input that is not finite is refused with DataError, a wrong shape with ConfigurationError."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ConfigurationError, DataError
from . import numpy_kernel
from .tree import RigidBodyTree

Array = np.ndarray


def regressor(tree: RigidBodyTree, q: Any, dq: Any, ddq: Any) -> Array:
    """Joint torque regressor (N, nv, 10 nb): tau = regressor @ inertia, gravity included.

    `q` (N, nq) in rad, m; `dq`, `ddq` (N, nv)."""
    q, dq, ddq = _states(tree, q, dq=dq, ddq=ddq)
    return _kernel().regressor(tree, q, dq, ddq)


def inverse_dynamics(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any, ddq: Any) -> Array:
    """Joint torque (N, nv) in N m, N. `inertia` (10 nb,) linear parameters; `q` (N, nq); `dq`, `ddq` (N, nv)."""
    q, dq, ddq = _states(tree, q, dq=dq, ddq=ddq)
    return _kernel().inverse_dynamics(tree, _inertia(tree, inertia), q, dq, ddq)


def mass_matrix(tree: RigidBodyTree, inertia: Any, q: Any) -> Array:
    """Joint-space mass matrix (N, nv, nv), symmetric; not positive definite where the parameters are not physical."""
    (q,) = _states(tree, q)
    return _kernel().mass_matrix(tree, _inertia(tree, inertia), q)


def bias_torque(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any) -> Array:
    """Coriolis, centrifugal and gravity torque (N, nv): the torque at zero acceleration."""
    q, dq = _states(tree, q, dq=dq)
    return _kernel().bias_torque(tree, _inertia(tree, inertia), q, dq)


def forward_dynamics(tree: RigidBodyTree, inertia: Any, q: Any, dq: Any, tau: Any, added: Any = None) -> Array:
    """Joint acceleration (N, nv) from (M(q) + added) ddq = tau - bias(q, dq).

    `added` (nv, nv): constant symmetric matrix, such as the reflected rotor inertia K^-T R K^-1; None for none.
    Raises DataError where the matrix is singular."""
    q, dq, tau = _states(tree, q, dq=dq, tau=tau)
    nv = tree.nv
    extra = np.zeros((nv, nv)) if added is None else _finite("added", added)
    if extra.shape != (nv, nv):
        raise ConfigurationError(f"added: expected shape ({nv}, {nv}), one row per velocity, but it is {extra.shape}.")
    if not np.allclose(extra, extra.T, rtol=1e-12, atol=1e-12 * float(np.abs(extra).max(initial=0.0))):
        raise ConfigurationError("added: must be symmetric (K^-T R K^-1 is), but it is not.")
    return _kernel().forward_dynamics(tree, _inertia(tree, inertia), q, dq, tau, extra)


def _kernel() -> Any:
    return numpy_kernel


def _finite(name: str, values: Any) -> Array:
    """`values` as contiguous float64 without NaN or infinity."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    # The sum is finite unless some entry is not (or the sum overflows): one pass, no boolean array.
    if array.size and not np.isfinite(array.sum()):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            where = ", ".join(str(int(i)) for i in bad[0])
            raise DataError(
                f"{name}: {len(bad)} value(s) are not finite, the first at [{where}] ({array[tuple(bad[0])]});"
                " leave these samples out or repair them first."
            )
    return array


def _inertia(tree: RigidBodyTree, inertia: Any) -> Array:
    array = _finite("inertia", inertia)
    if array.shape != (10 * tree.nb,):
        raise ConfigurationError(f"inertia: expected shape ({10 * tree.nb},), ten per moving body, but it is {array.shape}.")
    return array


def _states(tree: RigidBodyTree, q: Any, **rates: Any) -> list[Array]:
    """Checked arrays of positions (N, nq) and of the rates or torques (N, nv) given by name."""
    arrays = [_finite("q", q)]
    samples = len(arrays[0]) if arrays[0].ndim else 0
    if arrays[0].ndim != 2 or arrays[0].shape[1] != tree.nq:
        raise ConfigurationError(f"q: expected shape (N, {tree.nq}), samples by positions, but it is {arrays[0].shape}.")
    for name, values in rates.items():
        array = _finite(name, values)
        if array.shape != (samples, tree.nv):
            raise ConfigurationError(f"{name}: expected shape ({samples}, {tree.nv}), samples by velocities, but it is {array.shape}.")
        arrays.append(array)
    if tree.floating:
        norm = np.linalg.norm(arrays[0][:, 3:7], axis=1)
        if np.any(np.abs(norm - 1.0) > 1e-3):
            worst = int(np.argmax(np.abs(norm - 1.0)))
            raise DataError(f"q: the quaternion (columns 3 to 6, x y z w) of sample {worst} has length {norm[worst]:.6g} instead of 1.")
    return arrays
