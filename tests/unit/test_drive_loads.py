"""A known body added in one log gives unknown gains their scale."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import PENDULUM, commanded_log
from benchmarks.actuators.coverage import LEG
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.determined import Standing
from ident.drives.loads import Load
from ident.logs.log import LogSet
from ident.regressor import mass_matrix

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "kp": 25.0, "kd": 0.8, "delay": 0.006}
#: 0.5 kg, 0.3 m below the axis, on the pendulum of 0.6 kg, 0.2 m below it: one body of 1.1 kg.
MASS, DOWN = 0.5, 0.3
ADDED = {"joint": "joint1", "mass": MASS, "com": [0.0, 0.0, -DOWN]}


def loaded_pendulum() -> ident.Robot:
    """The pendulum whose URDF has both bodies as one."""
    whole = 0.6 + MASS
    centre = (0.6 * 0.2 + MASS * DOWN) / whole
    about = 0.6 * (0.2 - centre) ** 2 + MASS * (DOWN - centre) ** 2
    text = PENDULUM.replace("0 0 -0.2", f"0 0 {-centre}").replace('"0.6"', f'"{whole}"')
    text = text.replace('ixx="0.002"', f'ixx="{0.002 + about}"').replace('iyy="0.002"', f'iyy="{0.002 + about}"')
    return ident.Robot.from_urdf(text)


def test_parameters_are_those_of_pinocchio():
    robot = ident.Robot.from_urdf(LEG)
    load = Load("joint2", 0.7, (0.1, -0.2, 0.05), (0.01, 0.001, 0.02, -0.002, 0.003, 0.015))
    body = pin.Inertia(0.7, np.array(load.com), np.array([[0.01, 0.001, -0.002], [0.001, 0.02, 0.003], [-0.002, 0.003, 0.015]]))
    found = load.parameters(robot).reshape(-1, 10)
    np.testing.assert_allclose(found[1], body.toDynamicParameters(), atol=1e-15)
    assert not found[[0, 2]].any()


def test_the_loaded_pendulum_of_these_tests_is_the_sum():
    robot, both = ident.Robot.from_urdf(PENDULUM), loaded_pendulum()
    q = np.array([[0.3]])
    added = Load.read("here", ADDED, robot).parameters(robot)
    np.testing.assert_allclose(mass_matrix(robot.tree, robot.nominal + added, q), mass_matrix(both.tree, both.nominal, q), rtol=1e-12)


def fitted(*, known: bool, links: str, seed: int = 7201, effects: tuple[str, ...] = ()) -> DriveFit:
    """Of two logs, of which the second has the body; gains to be identified. `known`: whether it is declared."""
    robot = ident.Robot.from_urdf(PENDULUM)
    logs = [
        commanded_log(machine, TRUTH, seed=seed, seconds=5.0, rate=200, noise=5e-4, before=1.0, name=name)
        for machine, seed, name in ((robot, seed, "bare"), (loaded_pendulum(), seed + 1, "loaded"))
    ]
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    for name in effects:
        model = model + ident.make_effect(name)
    more = {"by_log": {"loaded": {"load": ADDED}}} if known else {}
    return fit_drives(LogSet(tuple(logs)), model, DriveLaw.of(robot, kp="identify", kd="identify", links=links, **more))


@needs_native
@pytest.mark.parametrize("links", ["known", "identify"])
def test_a_known_body_gives_the_scale(links, tmp_path):
    fit = fitted(known=True, links=links)
    at = fit.names.index("kp_joint1")
    assert fit.determination.verdicts[at] == Standing.DETERMINED
    assert abs(fit.values[at] - 25.0) < 3.0 * fit.determination.std[at] < 2.5
    assert np.sqrt(np.mean(fit.fit_rms**2)) == pytest.approx(5e-4, rel=0.05)
    assert not any("against the inertial parameters of the URDF" in text for text in fit.warnings)
    fit.save(tmp_path / "fit.json")
    again = DriveFit.load(tmp_path / "fit.json")
    assert again.law.for_log("loaded").load == fit.law.for_log("loaded").load is not None
    assert again.law.for_log("bare").load is None


@needs_native
@pytest.mark.parametrize("seed", [14624, 14626, 14634])
def test_what_is_next_to_nothing_is_not_distinguished(seed):
    """An offset and a first moment across, both none, trade with each other."""
    fit = fitted(known=True, links="identify", seed=seed, effects=("offset",))
    std = np.sqrt(np.diag(fit.covariance))
    for name in ("offset_joint1", "mx_joint1"):
        at = fit.names.index(name)
        assert abs(fit.values[at]) < 3.0 * std[at]


@needs_native
def test_without_it_the_logs_do_not_agree():
    fit = fitted(known=False, links="known")
    assert np.sqrt(np.mean(fit.fit_rms**2)) > 5e-3


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"mass": -1.0}, "above zero"),
        ({"com": [0.0, 0.1]}, "3 numbers"),
        ({"com": ["a", 0.0, 0.1]}, "3 numbers"),
        ({"joint": "elbow"}, "elbow"),
        ({"kg": 2.0}, "joint, mass"),
    ],
)
def test_a_wrong_body_is_refused(wrong, said):
    robot = ident.Robot.from_urdf(PENDULUM)
    with pytest.raises(ident.errors.ConfigurationError, match=said):
        DriveLaw.of(robot, kp=25.0, kd=0.8, by_log={"loaded": {"load": {**ADDED, **wrong}}})
