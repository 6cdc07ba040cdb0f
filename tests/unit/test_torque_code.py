"""Feed-forward torque as C and as NumPy code: the numbers of `Estimate.feedforward`, for every kind of robot and every declared formula."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from effect_robots import ROBOTS, smooth

import ident
from ident.effects.joint_effect import JointEffect
from ident.effects.kinds import Need
from ident.effects.motion import Motion
from ident.effects.reference import Reference
from ident.effects.registry import effect_types, make_effect
from ident.estimate.feedforward import FixedModel
from ident.exporting import Identified, export
from ident.exporting.formulas import formulas_of
from ident.exporting.targets.numpy_code import numpy_text
from ident.exporting.torque_code import TorqueCode
from ident.model import Model
from ident.robots.transmission import Side

Array = np.ndarray
COMPILER = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
#: Everything that declares a formula, and each of them on both sides where it can be.
WRITTEN = sorted(name for name, kind in effect_types().items() if issubclass(kind, JointEffect) and (kind.formulas or kind.factors))


def compiled(file: Path, n: int) -> Callable[[Array, Array, Array], Array]:
    """The function of a written C file, for states (N, n)."""
    assert COMPILER is not None
    library = file.with_suffix(".so")
    strict = ["-std=c99", "-O0", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run([COMPILER, *strict, "-shared", "-fPIC", "-o", str(library), str(file), "-lm"], check=True, capture_output=True)
    (name,) = [word for word in file.read_text().split() if "_feedforward(" in word and not word.startswith("*")][:1]
    function = getattr(ctypes.CDLL(str(library)), name.split("(")[0])
    doubles = ctypes.c_double * n

    def torque(q: Array, dq: Array, ddq: Array) -> Array:
        out = np.empty_like(q)
        for k, state in enumerate(zip(q, dq, ddq, strict=True)):
            tau = doubles()
            function(*(doubles(*x) for x in state), tau)
            out[k] = tau[:]
        return out

    return torque


def as_numpy(text: str) -> Callable[[Array, Array, Array], Array]:
    """The function of a written NumPy module."""
    names: dict[str, Callable[[Array, Array, Array], Array]] = {}
    exec(compile(text, "written", "exec"), names)
    return names["feedforward"]


def everything(robot: ident.Robot) -> Model:
    """Links, and every effect that declares a formula; some of them on the joint side once more."""
    effects = [make_effect(name) for name in WRITTEN if name != "counterbalance" or not all(j.prismatic for j in robot.joints)]
    more = [make_effect(name, side=Side.JOINT, label="b") for name in ("viscous", "stribeck", "load_dependent_friction")]
    spring = make_effect("linear_spring", side=Side.MOTOR, label="m")
    return Model(robot, (*robot.rigid_body().effects, *effects, *more, spring))


def test_the_formulas_are_those_that_say_so():
    assert {"stribeck", "load_dependent_friction", "counterbalance", "coulomb", "linear_spring"} <= set(WRITTEN)


@pytest.mark.parametrize("name", WRITTEN)
def test_a_formula_is_what_its_columns_are(name):
    """Each effect alone, by its own columns: a formula that drifts away from `basis` is found here."""
    robot = ROBOTS["pendulum"]()
    effect = make_effect(name)
    model = Model(robot, (*robot.rigid_body().effects, effect))
    values = np.random.default_rng(0).uniform(0.3, 1.0, len(model.parameters))
    _, q, dq, ddq = smooth(robot, 20, 200.0, 1)
    assert len(formulas_of(effect)) == len(type(effect).symbols)
    expected = FixedModel(model, values).torque(q, dq, ddq)
    made = as_numpy(numpy_text(TorqueCode.of(Identified(model, values))))
    assert np.abs(made(q, dq, ddq) - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("name", list(ROBOTS))
def test_code_gives_the_torque_of_the_model(name, tmp_path):
    """Coupled wrists, slides, loops, both measured sides; every declared formula at once."""
    robot = ROBOTS[name]()
    model = everything(robot)
    values = np.random.default_rng(3).uniform(0.2, 1.0, len(model.parameters))
    values[: len(robot.nominal)] = robot.nominal
    _, q, dq, ddq = smooth(robot, 25, 200.0, 0)
    dq[7] = 0.0
    motion = Motion.of(robot, q, dq, ddq)
    if model.needs & {Need.LOAD, Need.REFERENCE}:
        motion = motion.with_reference(Reference(model, values))
    expected = model.torque(motion, values)
    found = Identified(model, values)
    export(found, tmp_path / "torque.py", kind="numpy")
    made = as_numpy((tmp_path / "torque.py").read_text())
    assert np.abs(made(q, dq, ddq) - expected).max() <= 1e-10 * np.abs(expected).max()
    assert np.abs(made(q[3], dq[3], ddq[3]) - expected[3]).max() <= 1e-10 * np.abs(expected).max()
    if COMPILER is None:
        pytest.skip("no C compiler")
    export(found, tmp_path / "torque.c")
    assert np.abs(compiled(tmp_path / "torque.c", robot.n)(q, dq, ddq) - expected).max() <= 1e-10 * np.abs(expected).max()


def test_an_estimate_as_code_is_its_feedforward(tmp_path):
    """Absolutely to 1e-10 N m, of base values as they were fitted: no real links are looked for."""
    train, _ = ident.demo_logs()
    estimate = ident.fit(train, "puma560", held=0)
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-2, 2, (3, 50, 6)) * np.array([1.0, 1.5, 4.0])[:, None, None]
    expected = estimate.feedforward(q, dq, ddq)
    ident.export(estimate, tmp_path / "puma.py", kind="numpy")
    assert np.abs(as_numpy((tmp_path / "puma.py").read_text())(q, dq, ddq) - expected).max() < 1e-10
    if COMPILER is None:
        pytest.skip("no C compiler")
    ident.export(estimate, tmp_path / "puma.c")
    assert np.abs(compiled(tmp_path / "puma.c", 6)(q, dq, ddq) - expected).max() < 1e-10


def test_effects_without_a_formula_are_named(tmp_path):
    robot = ident.load_robot("scara")
    model = robot.rigid_body() + make_effect("offset_drift")
    with pytest.raises(ident.UnsupportedError, match="'offset_drift' declares no formula"):
        export(Identified(model, np.ones(len(model.parameters))), tmp_path / "x.c")
    assert not (tmp_path / "x.c").exists()
