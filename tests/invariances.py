"""Three robots with logs, and what must not change when the same is said otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import ident
from ident import Estimate, Log, Robot
from tests.fuzz import seeds
from tests.recorded import recorded

Array = np.ndarray
SLIDER = seeds.MIMIC.replace('<mimic joint="j2" multiplier="0.5" offset="0.1"/>', "")
ROBOTS = ("arm", "scara", "puma560")
EFFECTS = ("viscous", "coulomb")


@dataclass(frozen=True, eq=False)
class Case:
    """A robot, its declared model and a log of it."""

    robot: Robot
    log: Log

    @property
    def tau(self) -> Array:
        """Torque (N, n) on the side on which it is measured."""
        return next(iter(self.log.tau.values()))

    @property
    def torque_name(self) -> str:
        return "tau_m" if self.robot.transmission.measured == "motor" else "tau"

    def columns(self) -> dict[str, Array]:
        """The log's columns by our own names."""
        assert self.log.q is not None
        positions = {f"q{j + 1}": x for j, x in enumerate(self.log.q.T)}
        return {"t": self.log.t, **positions, **{f"{self.torque_name}{j + 1}": x for j, x in enumerate(self.tau.T)}}

    def fit(self, logs: object = None, robot: Robot | None = None, effects: tuple[str, ...] = EFFECTS, **options: object) -> Estimate:
        """The fit of the declared model, to other logs or for another robot."""
        where = self.robot if robot is None else robot
        return ident.fit(self.log if logs is None else logs, where, model=[ident.make_effect(e) for e in effects], held=0, **options)  # type: ignore[arg-type]


@lru_cache
def case(name: str) -> Case:
    robot = Robot.from_urdf(SLIDER) if name == "arm" else ident.load_robot(name)
    model = robot.rigid_body() + ident.Model(robot, [ident.make_effect(e) for e in EFFECTS])
    rng = np.random.default_rng(3)
    values = rng.uniform(0.5, 1.5, len(model.parameters))
    if robot.nominal is not None:
        values[: len(robot.nominal)] = robot.nominal
    return Case(robot, recorded(robot, model, values, seed=5, seconds=7.0, noise=0.02))


@lru_cache
def usual(name: str) -> Estimate:
    """The fit with which others are compared."""
    return case(name).fit()


def write(path: Path, columns: Mapping[str, Array], delimiter: str = ",", decimal: str = ".", end: str = "\n", head: str = "") -> Path:
    """A text with all digits."""
    rows = (delimiter.join(repr(float(x)).replace(".", decimal) for x in row) for row in zip(*columns.values(), strict=True))
    path.write_bytes((head + end.join([delimiter.join(columns), *rows]) + end).encode())
    return path


def same(
    one: Estimate, two: Estimate, tolerance: float, scale: float | Mapping[str, float] = 1.0, names: Mapping[str, str] | None = None
) -> None:
    """The same parameters, values and standard deviations. `scale`: by what `two`'s are to be multiplied; `names`: of `one`'s in `two`."""
    wanted = [n if names is None else renamed(n, names) for n in one.names]
    assert wanted == list(two.names)
    for i, name in enumerate(one.names):
        factor = scale if isinstance(scale, float) else scale.get(name, 1.0)
        size = max(abs(one.values[i]), one.std[i])
        assert abs(one.values[i] - factor * two.values[i]) <= tolerance * size, (name, one.values[i], factor * two.values[i])
        assert abs(one.std[i] - abs(factor) * two.std[i]) <= 10 * tolerance * one.std[i] + 1e-12 * size, (name, one.std[i], two.std[i])


def renamed(parameter: str, names: Mapping[str, str]) -> str:
    """`Izz_j1` → `Izz_shoulder`."""
    for old in sorted(names, key=len, reverse=True):
        if parameter.endswith(f"_{old}"):
            return parameter.removesuffix(old) + names[old]
    return parameter


def same_prediction(one: Estimate, two: Estimate, first: Log, second: Log, tolerance: float) -> None:
    """The same torque on the same motion, told in two ways."""
    a, b = (e.predict(ident.ZeroPhase(cutoff_hz=8.0)(ident.LogSet((log,), e.model.robot))) for e, log in ((one, first), (two, second)))
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * float(np.nanmax(np.abs(a))))
