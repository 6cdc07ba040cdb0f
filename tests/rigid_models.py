"""Kernels under test and random Pinocchio models, for the tests of the rigid-body kernels."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from ident.regressor import kernel_choice, numpy_drive, numpy_dynamics, numpy_rows, numpy_series
from ident.regressor.kernel_choice import Kernel
from ident.robots.tree import RigidBodyTree

Array = np.ndarray


def native() -> ModuleType | None:
    """The compiled kernel's module, or None where it was not built."""
    try:
        return importlib.import_module("ident.regressor.native")
    except ImportError:
        return None


needs_native = pytest.mark.skipif(native() is None, reason="the compiled kernel is not built")


def kernels() -> list[str]:
    """Every way of computation there is here: "numpy", and each instruction set of the compiled kernel."""
    module = native()
    return ["numpy", *(module.instruction_sets() if module is not None else ())]


@contextmanager
def using(name: str) -> Iterator[Kernel]:
    """The kernel of that name, with that instruction set for the time being."""
    module = native()
    if name == "numpy":
        yield Kernel(numpy_dynamics, numpy_rows, numpy_series, numpy_drive)
        return
    assert module is not None
    module.use_instruction_set(name)
    try:
        yield replace(kernel_choice.kernel(), dynamics=module, rows=module)
    finally:
        module.use_instruction_set(module.instruction_sets()[-1])


def random_model(rng: np.random.Generator, joints: int, floating: bool) -> pin.Model:
    """A random tree: revolute and prismatic joints about principal (either sense) and oblique axes, general and right-angled placements."""
    model = pin.Model()
    ids = [0]
    if floating:
        ids = [model.addJoint(0, pin.JointModelFreeFlyer(), _placement(rng), "base")]
    for k in range(joints):
        # Depth first, as a URDF gives it: Pinocchio's algorithms rely on it.
        parent = ids[-1]
        while parent > (1 if floating else 0) and rng.random() < 0.25:
            parent = model.parents[parent]
        ids.append(model.addJoint(parent, _joint(rng), _placement(rng), f"joint{k}"))
    for i in range(1, model.njoints):
        model.inertias[i] = pin.Inertia(rng.uniform(0.1, 5), rng.normal(size=3) * 0.2, _inertia(rng))
    model.gravity.linear = rng.normal(size=3) * 6
    return model


def _joint(rng: np.random.Generator) -> Any:
    kind = rng.integers(12)
    if kind < 6:
        kinds = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ, pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
        return kinds[kind]()
    axis = rng.normal(size=3)
    if kind >= 9:  # principal, either sense
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    axis /= np.linalg.norm(axis)
    return (pin.JointModelRevoluteUnaligned if rng.random() < 0.6 else pin.JointModelPrismaticUnaligned)(axis)


def _placement(rng: np.random.Generator) -> pin.SE3:
    rotation = pin.Quaternion(*(x := rng.normal(size=4)) / np.linalg.norm(x)).matrix()
    kind = rng.integers(3)
    if kind == 1:
        rotation = pin.rpy.rpyToMatrix(*(rng.integers(-2, 3, 3) * np.pi / 2))
    elif kind == 2:
        rotation = np.eye(3)
    return pin.SE3(rotation, rng.normal(size=3) * rng.integers(0, 2, 3))


def _inertia(rng: np.random.Generator) -> Array:
    points = rng.normal(size=(3, 3)) * 0.3
    second = points @ points.T
    return np.trace(second) * np.eye(3) - second + 1e-3 * np.eye(3)


def states(model: pin.Model, rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """Random q (count, nq), dq and ddq (count, nv)."""
    q = np.array([pin.randomConfiguration(model, -np.full(model.nq, 3.0), np.full(model.nq, 3.0)) for _ in range(count)])
    return q.reshape(count, model.nq), rng.normal(size=(count, model.nv)) * 2, rng.normal(size=(count, model.nv)) * 5


def parameters(model: pin.Model) -> Array:
    """Inertial parameters (10 nb,) of a model."""
    return np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])


def oracle(model: pin.Model, q: Array, dq: Array, ddq: Array) -> dict[str, Array]:
    """Pinocchio's regressor, inverse dynamics, mass matrix and bias at each sample."""
    data = model.createData()
    found: dict[str, list[Array]] = {"regressor": [], "inverse": [], "mass": [], "bias": []}
    for x, v, a in zip(q, dq, ddq, strict=True):
        found["regressor"].append(np.array(pin.computeJointTorqueRegressor(model, data, x, v, a)).reshape(model.nv, -1))
        found["inverse"].append(np.array(pin.rnea(model, data, x, v, a)))
        upper = np.triu(np.array(pin.crba(model, data, x)).reshape(model.nv, model.nv))
        found["mass"].append(upper + np.triu(upper, 1).T)
        found["bias"].append(np.array(pin.nonLinearEffects(model, data, x, v)))
    return {name: np.array(values) for name, values in found.items()}


def difference(given: Array, wanted: Array) -> float:
    """Largest difference, relative to the largest number."""
    return float(np.abs(given - wanted).max(initial=0.0) / max(float(np.abs(wanted).max(initial=0.0)), 1e-300))


def tree_of(model: pin.Model) -> RigidBodyTree:
    return RigidBodyTree.from_pinocchio(model)
