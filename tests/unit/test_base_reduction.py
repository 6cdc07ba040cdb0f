"""Numeric base reduction of the whole stack against closed expectations."""

from __future__ import annotations

import numpy as np
import pytest

from ident.effects.motion import Motion
from ident.effects.offset import Offset
from ident.effects.reduction import base_reduction, sample_columns
from ident.friction import Coulomb, RotorInertia, Stribeck, Viscous
from ident.model import Model
from ident.robots.robot import Robot


def chain(rpys: list[str], xyzs: list[str], kinds: list[str] | None = None) -> str:
    """URDF text of a serial chain with axes along z."""
    kinds = kinds or ["revolute"] * len(rpys)
    parts = ['<robot name="chain"><link name="l0"/>']
    for i, (rpy, xyz, kind) in enumerate(zip(rpys, xyzs, kinds, strict=True), 1):
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><origin rpy="{rpy}" xyz="{xyz}"/><parent link="l{i - 1}"/>'
            f'<child link="l{i}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return "".join(parts) + "</robot>"


@pytest.mark.parametrize("half_turn", ["1.5707963267948966", "1.57079633", "1.570796", "1.5708", "1.571", "1.57"])
def test_digits_of_a_right_angle_do_not_change_the_count(half_turn: str) -> None:
    urdf = chain(["0 0 0", f"{half_turn} 0 0", "0 0 0", f"-{half_turn} 0 0"], ["0 0 0", "0 0 0.2", "0.4 0 0.1", "0.02 0.3 0"])
    exact = chain(["0 0 0", "1.5707963267948966 0 0", "0 0 0", "-1.5707963267948966 0 0"], ["0 0 0", "0 0 0.2", "0.4 0 0.1", "0.02 0.3 0"])
    assert base_reduction(Robot.from_urdf(urdf).rigid_body()).names == base_reduction(Robot.from_urdf(exact).rigid_body()).names


def test_a_single_vertical_revolute_joint_shows_one_inertia() -> None:
    base = base_reduction(Robot.from_urdf(chain(["0 0 0"], ["0 0 0"])).rigid_body())
    assert base.names == ("Izz_j1",)
    assert base.count == 1
    assert len(base.zero) == 9


def test_a_vertical_prismatic_joint_shows_its_mass() -> None:
    base = base_reduction(Robot.from_urdf(chain(["0 0 0"], ["0 0 0"], ["prismatic"])).rigid_body())
    assert base.names == ("m_j1",)


def test_planar_pendulum_pair_counts() -> None:
    # Two horizontal parallel axes: Izz and two moments each (7N - 4 beta_1 - 2Q with beta_1 = 2, Q = 0).
    base = base_reduction(Robot.from_urdf(chain(["1.5708 0 0", "0 0 0"], ["0 0 0", "0.5 0 0"])).rigid_body())
    assert base.count == 6


def test_first_rotor_inertia_merges_into_the_link() -> None:
    robot = Robot.from_urdf(chain(["0 0 0", "1.5708 0 0"], ["0 0 0", "0 0 0.2"]), transmission=np.array([50.0, 80.0]), measured="motor")
    base = base_reduction(robot.rigid_body() + RotorInertia())
    assert not any(name.startswith("Ia") for name in base.names)
    row = base.regroup[base.names.index("Izz_j1")]
    assert row[[p.name for p in base.parameters].index("Ia_j1")] == pytest.approx(50.0**2)


def test_base_values_predict_the_same_torque_as_all_values() -> None:
    rng = np.random.default_rng(5)
    K = np.diag([0.02, -0.01, 0.03]) + np.array([[0, 0, 0], [0, 0, 0], [0, 0.004, 0]])
    robot = Robot.from_urdf(
        chain(["0 0 0", "1.57 0.3 0", "0.2 0 1"], ["0 0 0", "0.1 0 0.2", "0 0.3 0"], ["revolute", "revolute", "prismatic"]), transmission=K
    )
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb() + Offset()
    base = base_reduction(model)
    values = rng.normal(size=len(model.parameters))
    motion = Motion.of(robot, *(rng.normal(size=(3, 50, 3))))
    columns = model.columns(motion)
    assert columns[:, :, base.independent] @ base.base_values(values) == pytest.approx(columns @ values, rel=1e-9, abs=1e-9)
    assert columns @ base.expand(base.base_values(values)) == pytest.approx(columns @ values, rel=1e-9, abs=1e-9)


def test_choice_does_not_depend_on_the_samples() -> None:
    robot = Robot.from_urdf(chain(["0 0 0", "1.5708 0 0", "0.7 0 0"], ["0 0 0", "0 0 0.2", "0.3 0 0"]))
    model = robot.rigid_body() + Viscous()
    first, second = base_reduction(model, seed=0), base_reduction(model, seed=99)
    assert first.names == second.names
    assert first.regroup == pytest.approx(second.regroup, abs=1e-9)


def test_rank_equals_singular_values() -> None:
    robot = Robot.from_urdf(chain(["0.1 0.2 0.3", "1 0.4 0.2", "0.7 0 0", "0.3 1 0"], ["0 0 0", "0 0.1 0.2", "0.3 0 0", "0.1 0.1 0.1"]))
    model = Model(robot, robot.rigid_body().effects)
    columns = sample_columns(model, seed=3)
    singular = np.linalg.svd(columns, compute_uv=False)
    assert base_reduction(model).count == int(np.sum(singular > 1e-10 * singular[0]))


@pytest.mark.parametrize("ratio", [1.0, 50.0, 500.0, -5000.0])
def test_friction_near_standstill_stays_behind_any_gear(ratio: float) -> None:
    """At a usual speed of the joint its motor is so much faster than v_s that nothing is left of it."""
    robot = Robot.from_urdf(chain(["0 0 0", "1.5708 0 0"], ["0 0 0", "0 0 0.2"], ["prismatic", "revolute"]), transmission=np.full(2, ratio))
    base = base_reduction(robot.rigid_body() + Viscous() + Coulomb() + Stribeck(v_s=0.5))
    names = [p.name for p in base.parameters]
    assert {"Fv_j1", "Fc_j1", "Fs_j1", "Fs_j2"} <= set(base.names)
    assert not any(names[i].startswith("F") for i in base.zero)
