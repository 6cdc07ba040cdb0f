"""What is timed on: robots with base columns, drive columns and random motion; and the plain ways to which the kernel is compared."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

import ident
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.physical.judgement import Subject
from ident.physical.structure import InertiaStructure
from ident.regressor import numpy_dynamics, row_information
from ident.robots import nominal_values
from ident.robots.tree import RigidBodyTree

Array = np.ndarray


class Case:
    """A robot with base columns, drive columns and random motion of N samples."""

    def __init__(self, model: pin.Model, samples: int, K: Array | None = None, drives: int | None = None) -> None:
        rng = np.random.default_rng(0)
        self.model, self.tree, self.samples = model, RigidBodyTree.from_pinocchio(model), samples
        nv = model.nv
        self.q = rng.uniform(-2, 2, (samples, model.nq))
        if self.tree.floating:
            self.q[:, 3:7] /= np.linalg.norm(self.q[:, 3:7], axis=1)[:, None]
        self.dq, self.ddq, self.tau = (rng.normal(size=(samples, nv)) for _ in range(3))
        self.rows = np.eye(nv) if K is None else K.T.copy()
        base = base_columns(self.tree)
        drives = nv if drives is None else drives
        rates = self.dq if K is None else self.dq @ np.linalg.inv(K).T
        accelerations = self.ddq if K is None else self.ddq @ np.linalg.inv(K).T
        # Coulomb, viscous and rotor-inertia columns, as many as asked for from the end.
        self.extra = np.ascontiguousarray(np.concatenate([accelerations, rates, np.sign(rates)], axis=1)[:, 3 * nv - drives :])
        self.pattern = np.ascontiguousarray(np.tile(np.eye(nv), 3)[:, 3 * nv - drives :])
        self.columns = np.concatenate([base, 10 * self.tree.nb + np.arange(drives)])
        self.inertia = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
        self.added = np.diag(np.full(nv, 0.5))

    def information(self, form: Literal["triangle", "gram"], samples: int | None = None, threads: int = 1) -> Array:
        """Factors of the first samples."""
        part = slice(samples)
        return row_information.information(
            self.tree, self.q[part], self.dq[part], self.ddq[part], self.tau[part], rows=self.rows, columns=self.columns,
            extra=self.extra[part], pattern=self.pattern, form=form, threads=threads,
        )[0]  # fmt: skip

    def stacked(self, samples: int) -> Array:
        """Columns (N, R, k) of the first samples by Pinocchio's loop."""
        model, data, nv = self.model, self.model.createData(), self.tree.nv
        loop = [
            np.array(pin.computeJointTorqueRegressor(model, data, a, b, c)).reshape(nv, -1)
            for a, b, c in zip(self.q[:samples], self.dq[:samples], self.ddq[:samples], strict=True)
        ]
        return np.concatenate([self.rows @ np.stack(loop), self.extra[:samples, None, :] * self.pattern], axis=2)[:, :, self.columns]

    def lstsq(self, samples: int) -> Array:
        """Regressor by the loop, stacking of all columns, and numpy.linalg.lstsq."""
        Y = self.stacked(samples)
        return np.linalg.lstsq(Y.reshape(-1, Y.shape[2]), self.tau[:samples].reshape(-1), rcond=None)[0]

    def loop(self, what: Literal["regressor", "inverse", "forward"], samples: int) -> Callable[[], Any]:
        """Pinocchio's function sample by sample, its results thrown away."""
        model, data = self.model, self.model.createData()
        run = {"regressor": pin.computeJointTorqueRegressor, "inverse": pin.rnea, "forward": pin.aba}[what]
        return lambda: [run(model, data, a, b, c) for a, b, c in zip(self.q[:samples], self.dq[:samples], self.ddq[:samples], strict=True)]


def puma(samples: int) -> Case:
    """PUMA 560 on the motor side with its coupled gears: 36 links' base columns, 16 of the drives."""
    robot = ident.load_robot("puma560")
    return Case(robot.model, samples, robot.transmission.K, drives=16)


def base_columns(tree: RigidBodyTree) -> Array:
    """Independent columns of the regressor, by orthogonalisation of random samples."""
    rng = np.random.default_rng(1)
    count = 20 * tree.nb // tree.nv + 40
    q = rng.uniform(-2, 2, (count, tree.nq))
    if tree.floating:
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    Y = numpy_dynamics.regressor(tree, q, *rng.normal(size=(2, count, tree.nv))).reshape(-1, 10 * tree.nb)
    length = np.linalg.norm(Y, axis=0)
    order = [10 * i + k for i in range(tree.nb) for k in (9, 4, 5, 7, 8, 1, 2, 3, 6, 0) if length[10 * i + k] > 1e-9 * length.max()]
    diagonal = np.abs(np.diag(np.linalg.qr(Y[:, order] / length[order], mode="r")))
    return np.sort(np.array(order)[diagonal > 1e-8])


def chain(joints: int) -> pin.Model:
    """A serial arm of revolute joints about z, each turned by a right angle against the last."""
    rng = np.random.default_rng(joints)
    model = pin.Model()
    parent = 0
    for j in range(joints):
        turn = pin.rpy.rpyToMatrix(np.pi / 2 * (j % 2), 0, 0)
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(turn, np.array([0.1, 0.0, 0.2])), f"joint{j + 1}")
        model.inertias[parent] = pin.Inertia(1.0, rng.normal(size=3) * 0.1, np.eye(3) * 0.05)
    return model


def serial_arm(joints: int) -> ident.Robot:
    """The robot of a serial arm of revolute joints with bodies of unlike size, with limits of 2.5 rad."""
    rng = np.random.default_rng(joints)
    parts = ['<robot name="arm"><link name="base"/>']
    for j in range(1, joints + 1):
        mass = float(np.exp(rng.uniform(-1, 1)) * (1 - 0.02 * j))
        com = " ".join(f"{x:.4f}" for x in rng.uniform(-0.1, 0.1, 3))
        inertia = mass * np.array([0.05, 0.08, 0.06]) * np.exp(rng.uniform(-0.5, 0.5, 3))
        moments = " ".join(f'{name}="{x:.5f}"' for name, x in zip(("ixx", "iyy", "izz"), inertia, strict=True))
        parts.append(
            f'<link name="link{j}"><inertial><origin xyz="{com}"/><mass value="{mass:.4f}"/>'
            f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        parent, turn = ("base" if j == 1 else f"link{j - 1}"), np.pi / 2 * (j % 2)
        parts.append(
            f'<joint name="joint{j}" type="revolute"><parent link="{parent}"/><child link="link{j}"/><origin xyz="0.1 0 0.2"'
            f' rpy="{turn:.10f} 0 0"/><axis xyz="0 0 1"/><limit lower="-2.5" upper="2.5" effort="100" velocity="5"/></joint>'
        )
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text("\n".join([*parts, "</robot>"]))
        return ident.Robot.from_urdf(path)


def noisy_subject(joints: int) -> Subject:
    """A serial arm's base parameters with rotor inertia and friction, each of a standard deviation of some percent."""
    model = serial_arm(joints).rigid_body() + RotorInertia() + Viscous() + Coulomb()
    everything = nominal_values(model)
    rotors = [name.startswith("Ia_") for name in model.names]
    everything[rotors] = 0.02 / (1.0 + np.arange(joints))  # as gears of 100 reflect them
    values = model.base.base_values(everything)
    covariance = np.diag((0.03 * np.abs(values) + 1e-3) ** 2)
    return Subject("nominal", InertiaStructure.from_model(model, model.base), values, covariance)


def humanoid() -> pin.Model | None:
    """Talos on a free-flyer, where example-robot-data is installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        return None
    found = [f for f in files if str(f).endswith("talos_reduced.urdf")]
    return pin.buildModelFromUrdf(str(found[0].locate()), pin.JointModelFreeFlyer()) if found else None
