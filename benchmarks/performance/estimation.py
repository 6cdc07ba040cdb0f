"""Recursion, instrumental variables, simulation and import, each against what it is compared to."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import Any

import numpy as np

import ident
from ident.effects.motion import Motion
from ident.estimators import InstrumentalVariable, RecursiveLeastSquares
from ident.regressor import rigid
from ident.simulation.controller import Script
from ident.simulation.simulate import Plant

from .make_large_log import Puma
from .table import Row
from .timing import Work, best, together

Array = np.ndarray
#: Samples between two looks at a recursion's state, and of a batch that stays in the cache.
_STRIDE, _PIECE = 1200, 8192


def recursion_row(samples: int) -> Row:
    """Square-root recursive least squares over columns (samples, 6, 52), its state at hand every 1200 samples, against
    filterpy's Kalman filter with constant state, which gives the same values; filterpy is timed on its first samples."""
    from filterpy.kalman import KalmanFilter

    puma = Puma(1)
    q, dq, ddq, tau = puma.motion(np.arange(samples) / 200.0)
    tau = tau + puma.noise * np.random.default_rng(0).normal(size=tau.shape)
    estimator = RecursiveLeastSquares(noise_std=tuple(puma.noise))
    start = estimator.start(puma.model)
    columns = np.concatenate(
        [
            puma.model.columns(Motion.of(puma.robot, q[a:b], dq[a:b], ddq[a:b]))[:, :, start.base.independent]
            for a, b in zip(range(0, samples, 10_000), [*range(10_000, samples, 10_000), samples], strict=True)
        ]
    )

    def ours() -> Any:
        state = start
        for a in range(0, samples, _STRIDE):
            state = state.update(columns[a : a + _STRIDE], tau[a : a + _STRIDE])
        return state

    few, compared, b = 600, min(6000, samples), columns.shape[2]
    state = start.update(columns[:compared], tau[:compared])

    def theirs(count: int = few) -> Array:
        kalman = KalmanFilter(dim_x=b, dim_z=columns.shape[1])
        kalman.P = np.diag((1e3 * (np.abs(state.values) + state.std)) ** 2)  # nothing known, in each parameter's own size
        kalman.R = np.diag(puma.noise**2)
        for H, z in zip(columns[:count], tau[:count], strict=True):
            kalman.update(z[:, None], H=H)
        return kalman.x[:, 0]

    def live() -> None:
        state = start
        for i in range(20):
            state = state.observe(q[i], dq[i], ddq[i], tau[i])

    found = together({"ours": Work(ours, samples), "filterpy": Work(theirs, few), "live": Work(live, 20)}, rounds=3)
    gap = float(np.max(np.abs(theirs(compared) - state.values) / state.std))
    return Row(
        f"recursion of {samples} samples, 6 x {b}", found["ours"] * samples * 1e-6, "s", 0.25 * samples / 120_000,
        ((f"filterpy's update (timed on {few} samples)", found["filterpy"] * samples * 1e-6, None),),
        "a factorisation of dense rows: 0.9 µs a sample for 6 x 53 x 53 numbers",
        f"state every {_STRIDE} samples; equal to filterpy after {compared} samples to {gap:.1e} std; a live sample in and its state out:"
        f" {found['live']:.0f} µs a call",
    )  # fmt: skip


def instrument_rows(samples: int) -> list[Row]:
    """An iteration of instrumental variables on raw samples: the plain one by the kernel, and that of the estimator."""
    puma = Puma(1)
    q, dq, ddq, tau = puma.motion(np.arange(samples) / 200.0)
    tau = tau + puma.noise * np.random.default_rng(0).normal(size=tau.shape)
    return [_plain_iteration(puma, (q, dq, ddq), tau), _own_iteration(puma, q, tau)]


def _plain_iteration(puma: Puma, motion: tuple[Array, Array, Array], tau: Array) -> Row:
    """Accelerations that the model gives to the measured torque, then all products of instruments, columns and torque in one pass."""
    robot, model, samples = puma.robot, puma.model, len(tau)
    inertia, rotor, viscous, coulomb = (puma.values[part] for part in model.slices)
    K, inverse = robot.transmission.K, np.linalg.inv(robot.transmission.K)
    added = inverse.T @ np.diag(rotor) @ inverse
    pair, rows, pattern = rigid.paired(robot.tree), np.tile(K.T, 2), np.tile(np.eye(6), 6)
    chosen = model.base.independent
    # Links of both trees come first, then drive columns of instruments and of the regressor.
    columns = np.concatenate([np.where(chosen < 60, chosen, chosen + 60), np.where(chosen < 60, chosen + 60, chosen + 78)])

    def part(place: slice) -> Array:
        q, dq, ddq = (x[place] for x in motion)
        speed = dq @ inverse.T
        direction = np.sign(speed)
        force = (tau[place] - speed * viscous - direction * coulomb) @ inverse
        made = rigid.forward_dynamics(robot.tree, inertia, q, dq, force, added, threads=1)
        extra = np.concatenate([made @ inverse.T, speed, direction, ddq @ inverse.T, speed, direction], axis=1)
        both = [np.concatenate(x, axis=1) for x in ((q, q), (dq, dq), (made, ddq))]
        given = {"rows": rows, "columns": columns, "extra": extra, "pattern": pattern, "form": "gram", "threads": 1}
        return rigid.information(pair, *both, tau[place], **given)[0]

    def iteration() -> Array:
        return np.sum([part(slice(a, min(a + _PIECE, samples))) for a in range(0, samples, _PIECE)], axis=0)

    return Row(
        f"plain IV iteration of {samples} samples by the kernel (accelerations; products of instruments, columns, torque)",
        best(iteration, 1, budget=4.0) * 1e-3, "ms", 60.0 * samples / 1e5,
        why="products of twice as many columns, four times those of the information itself",
    )  # fmt: skip


def _own_iteration(puma: Puma, q: Array, tau: Array) -> Row:
    """The estimator on a log whose positions are rounded: time of all it does over the iterations it took."""
    from ident.logs.log import Log, LogSet

    robot, samples, counts = puma.robot, len(q), 40_000 / (2 * np.pi)
    log = Log("raw", np.arange(samples) / 200.0, q=np.round(q * counts) / counts, tau={robot.transmission.measured.value: tau})
    problem = ident.Problem(puma.model, ident.CentralDifference()(LogSet((log,), robot)))
    problem.information  # noqa: B018  made before the clock starts: every method needs it
    start = time.thread_time()
    estimate = InstrumentalVariable(iterations=2).solve(problem)
    seconds = time.thread_time() - start
    return Row(
        f"method 'iv' on {samples} raw samples, weighted by the noise's colour, per iteration",
        seconds / len(estimate.trace["steps"]) * 1e3, "ms", 60.0 * samples / 1e5,
        why="every iteration fits the noise's colour anew and filters rows and instruments by it, in NumPy;"
        " tests and covariance of the result are in it too",
    )  # fmt: skip


def simulation_rows() -> list[Row]:
    """A Runge-Kutta step with dry friction of the PUMA; no reversal on the way."""
    single, eight = step_time(1), step_time(8)
    loop = _pinocchio_step()
    others = (("four calls of Pinocchio's aba in Python", loop, None),)
    why = "four forward dynamics: 0.32 µs each for a single state, 0.09 µs for one of eight"
    return [
        Row("simulation step with dry friction (RK4), one run", single, "µs", 1.5, others, why),
        Row("simulation step with dry friction (RK4), a run of eight", eight, "µs", 0.4, others, why),
    ]


def _pinocchio_step() -> float:
    import pinocchio as pin

    model = ident.load_robot("puma560").model
    data, state = model.createData(), np.full(6, 0.3)

    def four() -> None:
        for _ in range(4):
            pin.aba(model, data, state, state, state)

    return best(lambda: [four() for _ in range(500)], 500)


def step_time(lanes: int) -> float:
    """Microseconds of a Runge-Kutta step of one run of `lanes`; NaN without the compiled kernel."""
    puma = Puma(1)
    dynamics = Plant(puma.model, puma.values).dynamics()
    if dynamics.compiled is None:
        return float("nan")
    compiled, periods, substeps = dynamics.compiled, 20, 100
    script = Script(puma.robot.transmission.measured, np.zeros((periods, lanes, puma.robot.n)))
    speed = np.tile(puma.robot.transmission.joint_rate(np.full(puma.robot.n, 30.0)), (lanes, 1))
    state = dynamics.start(np.zeros(lanes), np.zeros((lanes, puma.robot.n)), speed)
    steps = lanes * periods * substeps
    return best(lambda: compiled.run(script, state, None, period=1e-6 * substeps, substeps=substeps), steps, rounds=20)


def import_row() -> Row:
    """`import ident` in a new process beyond an empty one."""

    def once(code: str) -> float:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        return time.perf_counter() - start

    pairs = [(once("import ident"), once("pass")) for _ in range(5)]
    return Row(
        "import ident", min(a for a, _ in pairs) - min(b for _, b in pairs), "s", 0.5, why="the disk, or what the interpreter imports first"
    )
