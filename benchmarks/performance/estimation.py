"""Recursion, instrumental variables and simulation, each against what it is compared to."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import ident
from ident.effects.motion import Motion
from ident.estimators import InstrumentalVariable, RecursiveLeastSquares
from ident.logs.log import Log, LogSet
from ident.physical import judge
from ident.regressor import rigid, row_information
from ident.simulation.plant import Plant
from ident.simulation.replay import replay
from ident.simulation.script import Script

from .cases import noisy_subject, puma
from .limits import Limit, profiled
from .make_large_log import Puma
from .table import Row
from .timing import Work, multiplications, together

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

    found = together({"ours": Work(ours, samples), "filterpy": Work(theirs, few)}, budget=0.0)
    rate, operations = multiplications(), 2 * columns.shape[1] * (b + 1) ** 2
    limit = Limit(((f"{operations} operations a sample at dgemm's {rate:.0f} GFLOP/s", operations / rate * samples * 1e-9),))
    gap = float(np.max(np.abs(theirs(compared) - state.values) / state.std))
    return Row(
        f"recursion of {samples} samples, 6 x {b}", found["ours"] * samples * 1e-6, "s", 0.25 * samples / 120_000,
        ((f"filterpy's update (timed on {few} samples)", found["filterpy"] * samples * 1e-6, None),),
        limit.why(found["ours"] * samples * 1e-6, "s"),
        f"state every {_STRIDE} samples; equal to filterpy after {compared} samples to {gap:.1e} std",
    )  # fmt: skip


def instrument_rows(samples: int) -> list[Row]:
    """An iteration of instrumental variables on raw samples: the plain one by the kernel, and that of the estimator."""
    puma = Puma(1)
    q, dq, ddq, tau = puma.motion(np.arange(samples) / 200.0)
    tau = tau + puma.noise * np.random.default_rng(0).normal(size=tau.shape)
    plain = _plain_iteration(puma, (q, dq, ddq), tau)
    return [plain, _own_iteration(puma, q, tau, plain.measured)]


class PlainIteration:
    """Plain instrumental variables by the kernel, piece by piece: accelerations that the model gives to the measured torque, then the
    products of these instruments with columns and torque. What a piece needs has its place in memory once."""

    def __init__(self, puma: Puma, motion: tuple[Array, Array, Array], tau: Array) -> None:
        robot, chosen = puma.robot, puma.model.base.independent
        self.motion, self.tau, self.robot, self.count = motion, tau, robot, len(chosen)
        inertia, rotor, self.viscous, self.coulomb = (puma.values[part] for part in puma.model.slices)
        self.inverse = np.linalg.inv(robot.transmission.K)
        self.dynamics = rigid.dynamics(robot.tree, inertia, self.inverse.T @ np.diag(rotor) @ self.inverse)
        self.pair = row_information.paired(robot.tree)
        # Links of both trees come first, then drive columns of instruments and of the regressor.
        columns = np.concatenate([np.where(chosen < 60, chosen, chosen + 60), np.where(chosen < 60, chosen + 60, chosen + 78)])
        rows = np.tile(robot.transmission.K.T, 2)
        self.given: Any = {"rows": rows, "columns": columns, "pattern": np.tile(np.eye(6), 6), "form": "gram", "threads": 1}
        self.parts = np.empty((_PIECE, 12)), np.empty((_PIECE, 12)), np.empty((_PIECE, 12)), np.empty((_PIECE, 36))

    def __call__(self) -> Array:
        """Z' [Phi tau] of each row, at [:b, b:] of (6, 2 b + 1, 2 b + 1)."""
        samples = len(self.tau)
        return np.sum([self._part(slice(a, min(a + _PIECE, samples))) for a in range(0, samples, _PIECE)], axis=0)

    def _part(self, place: slice) -> Array:
        (q, dq, ddq), tau = (x[place] for x in self.motion), self.tau[place]
        speed = dq @ self.inverse.T
        direction = np.sign(speed)
        made = self.dynamics.forward(q, dq, (tau - speed * self.viscous - direction * self.coulomb) @ self.inverse)
        parts = tuple(x[: len(tau)] for x in self.parts)
        for out, pair in zip(parts, ((q, q), (dq, dq), (made, ddq)), strict=False):
            _beside(out, *pair)
        _beside(parts[3], made @ self.inverse.T, speed, direction, ddq @ self.inverse.T, speed, direction)
        pair_q, pair_dq, pair_ddq, extra = parts
        return row_information.information(self.pair, pair_q, pair_dq, pair_ddq, tau, extra=extra, split=self.count, **self.given)[0]


def _beside(out: Array, *parts: Array) -> None:
    """Contiguous arrays (m, 6) beside each other in `out`; six numbers at a time are copied as one."""
    six = np.dtype((np.void, 48))
    for place, part in enumerate(parts):
        out.view(six)[:, place] = part.view(six)[:, 0]


def pass_of(puma: Puma, motion: tuple[Array, Array, Array], tau: Array) -> Callable[[], Array]:
    """An information pass over samples, from positions and rates to the Gram matrices of links and drives, piece by piece."""
    robot, chosen, inverse = puma.robot, puma.model.base.independent, np.linalg.inv(puma.robot.transmission.K)
    given: Any = {"rows": robot.transmission.K.T, "columns": chosen, "pattern": np.tile(np.eye(6), 3), "form": "gram", "threads": 1}

    def part(place: slice) -> Array:
        q, dq, ddq = (x[place] for x in motion)
        rate = dq @ inverse.T
        extra = np.concatenate([ddq @ inverse.T, rate, np.sign(rate)], axis=1)
        return row_information.information(robot.tree, q, dq, ddq, tau[place], extra=extra, **given)[0]

    return lambda: np.sum([part(slice(a, min(a + _PIECE, len(tau)))) for a in range(0, len(tau), _PIECE)], axis=0)


def _plain_iteration(puma: Puma, motion: tuple[Array, Array, Array], tau: Array) -> Row:
    """A plain iteration beside an information pass of the same samples."""
    samples, iteration, information = len(tau), PlainIteration(puma, motion, tau), pass_of(puma, motion, tau)
    found = together({"plain": Work(iteration, 1), "information": Work(information, 1)}, budget=6.0)
    plain, once = found["plain"] * 1e-3, found["information"] * 1e-3
    limit = Limit((("two information passes, as each instrument meets each column,", 2 * once),))
    return Row(
        f"plain IV iteration of {samples} samples by the kernel (accelerations; products of instruments with columns and torque)",
        plain, "ms", 3.0 * once, (("an information pass of the same samples", once, None),), limit.why(plain, "ms"),
    )  # fmt: skip


def _own_iteration(puma: Puma, q: Array, tau: Array, plain: float) -> Row:
    """The estimator on a log whose positions are rounded: time of an iteration more, and memory in a process of its own."""
    problem = raw_problem(puma, q, tau)
    few, more = InstrumentalVariable(iterations=2), InstrumentalVariable(iterations=6)
    found = together({"few": Work(lambda: few.solve(problem), 1), "more": Work(lambda: more.solve(problem), 1)}, budget=0.0)
    steps = [len(e.solve(problem).trace["steps"]) for e in (few, more)]
    each = (found["more"] - found["few"]) * 1e-3 / max(steps[1] - steps[0], 1)
    once = found["few"] * 1e-3 - steps[0] * each
    regressor, memory = 8e-6 * len(q) * puma.robot.n * problem.base.count, _own_memory(len(q))
    return Row(
        f"method 'iv' on {len(q)} raw samples, weighted by the noise's colour, per iteration",
        each, "ms", 600.0 * len(q) / 1e5, (("a plain IV iteration", plain, 1 / 6),), profiled(lambda: more.solve(problem), 8),
        f"start, tests and covariance once {once:.0f} ms; memory beyond the log {memory:.0f} MB, the regressor's own {regressor:.0f} MB",
    )  # fmt: skip


def raw_problem(puma: Puma, q: Array, tau: Array) -> ident.Problem:
    """The problem of a log with positions as an encoder of 40000 counts a turn has them, differenced, with its information made."""
    robot, counts = puma.robot, 40_000 / (2 * np.pi)
    log = Log("raw", np.arange(len(q)) / 200.0, q=np.round(q * counts) / counts, tau={robot.transmission.measured.value: tau})
    problem = ident.Problem(puma.model, ident.CentralDifference()(LogSet((log,), robot)))
    problem.information  # noqa: B018  every method needs it
    return problem


def _own_memory(samples: int) -> float:
    """Megabytes by which a fit raises the largest memory of a process that has the problem, with what it loads on its way."""
    code = (
        "from benchmarks.performance.estimation import InstrumentalVariable, Puma, np, raw_problem\n"
        "from benchmarks.performance.streaming import peak\n"
        f"puma = Puma(1); q, _, _, tau = puma.motion(np.arange({samples}) / 200.0)\n"
        "problem = raw_problem(puma, q, tau + puma.noise * np.random.default_rng(0).normal(size=tau.shape)); before = peak()\n"
        "InstrumentalVariable(iterations=2).solve(problem); print(peak() - before)"
    )
    return float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)


def simulation_rows() -> list[Row]:
    """A Runge-Kutta step with dry friction of the PUMA; no reversal on the way."""
    case = puma(8192)
    fixed = rigid.dynamics(case.tree, case.inertia, case.added)
    works = {"one run": step_work(1), "a run of eight": step_work(8), "pinocchio": _pinocchio_steps()}
    found = together({**works, "forward": Work(lambda: fixed.forward(case.q, case.dq, case.tau), 8192)})
    loop, forward = found.pop("pinocchio"), found.pop("forward")
    others = (("four calls of Pinocchio's aba in Python", loop, None),)
    limit = Limit((("four forward dynamics of the kernel, in a batch,", 4 * forward),))
    return [
        Row(f"simulation step with dry friction (RK4), {what}", step, "µs", 4 * limit.value, others, limit.why(step, "µs"))
        for what, step in found.items()
    ]


def _pinocchio_steps() -> Work:
    import pinocchio as pin

    model = ident.load_robot("puma560").model
    data, state = model.createData(), np.full(6, 0.3)

    def four() -> None:
        for _ in range(4):
            pin.aba(model, data, state, state, state)

    def steps() -> None:
        for _ in range(500):
            four()

    return Work(steps, 500)


def replay_row() -> Row:
    """Replay of a log of the demonstration, window by window, under the measured torque."""
    train, test = ident.demo_logs()
    robot = ident.load_robot("puma560")
    estimate, signals = ident.fit(train, robot, held=0), ident.ZeroPhase()(test, robot)
    model, values = estimate.model, estimate.all_values
    shown = replay(model, values, signals)
    windows, steps = len(shown.starts), (len(shown.t) - 1) * len(shown.starts)
    works = {
        "compiled": Work(lambda: replay(model, values, signals), 1),
        # To count evaluations, the general integrator is taken.
        "general": Work(lambda: replay(model, values, signals, most=10**9), 1),
        "step": step_work(8),
    }
    found = together(works, budget=0.0)
    seconds, limit = found["compiled"] * 1e-6, Limit(((f"{steps} steps of the compiled integrator", found["step"] * steps * 1e-6),))
    gap = float(np.nanmax(np.abs(shown.simulated - replay(model, values, signals, most=10**9).simulated)))
    return Row(
        f"replay of {windows} windows of {shown.t[-1]:.2g} s of the PUMA with friction", seconds, "s", 0.2,
        (("the general integrator", found["general"] * 1e-6, None),), limit.why(seconds, "s"), f"both equal to {gap:.1g} rad",
    )  # fmt: skip


def judgement_row(joints: int) -> Row:
    """Judgement of a set of parameters: positive definite everywhere, physically consistent, distance to the border."""
    subject = noisy_subject(joints)
    seconds = together({"": Work(lambda: judge(subject), 1)}, budget=0.0)[""] * 1e-6
    return Row(
        f"judgement of {joints} joints, {len(subject.values)} parameters", seconds, "s", 3.0, why=profiled(lambda: judge(subject), 6)
    )


def step_work(lanes: int) -> Work:
    """Runge-Kutta steps of `lanes` runs; its unit is a step of one of them."""
    puma = Puma(1)
    plant = Plant(puma.model, puma.values)
    compiled, periods, substeps = plant.compiled(), 20, 100
    assert compiled is not None
    script = Script(puma.robot.transmission.measured, np.zeros((periods, lanes, puma.robot.n)))
    speed = np.tile(puma.robot.transmission.joint_rate(np.full(puma.robot.n, 30.0)), (lanes, 1))
    state = plant.dynamics().start(np.zeros(lanes), np.zeros((lanes, puma.robot.n)), speed)
    steps = lanes * periods * substeps
    return Work(lambda: compiled.run(script, state, None, period=1e-6 * substeps, substeps=substeps), steps)
