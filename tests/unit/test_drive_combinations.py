"""What is printed of unknowns that a log cannot tell apart: decided by the value of what is printed, on information of one's own making."""

from __future__ import annotations

import re

import numpy as np
import pytest

import ident
from benchmarks.actuators import run
from ident.drives import fit_drives
from ident.drives.determined import Determination, Standing, determination
from ident.drives.uncertainty import Precision
from ident.drives.unknowns import Unknown
from ident.logs.log import LogSet

KP, KD = Unknown("kp_joint1", "N m/rad", "kp", 0), Unknown("kd_joint1", "N m s/rad", "kd", 0)
FV, FC = Unknown("Fv_joint1", "N m s/rad", "viscous", 0), Unknown("Fc_joint1", "N m", "dry", 0)
OFFSET, MX = Unknown("offset_joint1", "N m", "offset", 0, -np.inf), Unknown("mx_joint1", "kg m", "link", -1, -np.inf)
DELAY = Unknown("delay", "s", "delay_s", -1)
#: Sizes that are usual, by which a search measures.
USUAL = {"kp": 20.0, "kd": 0.3, "viscous": 0.1, "dry": 0.1, "offset": 0.1, "link": 0.1, "delay_s": 0.005, "armature": 0.01}


def decided(unknowns, values, seen) -> Determination:
    """A log that sees linear combinations (m, p) of the unknowns, each with the standard deviation given with it."""
    rows = np.array([np.asarray(row, float) / std for row, std in seen])
    values = np.asarray(values, float)
    scale = np.maximum(np.abs(values), [USUAL[u.place] for u in unknowns])
    information = (rows * scale).T @ (rows * scale)
    return determination(unknowns, values, Precision(information, information, scale), 0.005)


def standing(found: Determination, unknowns) -> dict[str, Standing]:
    return {u.name: v for u, v in zip(unknowns, found.verdicts, strict=True)}


def test_two_numbers_in_a_fixed_ratio_are_told_as_one():
    """kp - 14 kd would be 2.8 ± 5.4: as a difference nothing is known, as a ratio an eighth."""
    found = decided([KP, KD], [42.2, 2.81], [([1.0, -14.0], 5.4), ([0.0, 1.0], 1.5)])
    (one,) = found.combinations
    assert one.expression == "kp_joint1 / kd_joint1"
    assert one.value == pytest.approx(42.2 / 2.81)
    # Its exponent is 0.93 and not 1: what is not known of kd adds to it.
    share = np.hypot(5.4 / 42.2, (1.0 - 14.0 * 2.81 / 42.2) * 1.5 / 2.81)
    assert one.std / one.value == pytest.approx(share, rel=1e-6)
    assert not found.bounded
    assert set(standing(found, [KP, KD]).values()) == {Standing.CONFOUNDED}


def test_a_sum_that_may_be_nothing_has_a_bound_and_no_value():
    found = decided([MX, OFFSET], [-0.19, 1.69], [([1.0, 0.1], 0.015), ([0.0, 1.0], 40.0)])
    assert not found.combinations
    (one,) = found.bounded
    assert one.expression == "mx_joint1 + 0.1 offset_joint1"
    assert one.below == pytest.approx(abs(-0.19 + 0.169) + 0.03, rel=0.01)


@pytest.mark.parametrize("viscous", [0.0, 0.01, 0.44, 0.87, 0.88])
def test_a_sum_is_the_same_wherever_the_search_ended_in_its_valley(viscous):
    """Also where it gave all of it to one of them, which then seems to have no effect."""
    unknowns = [FV, FC, KD]
    found = decided(unknowns, [viscous, 0.15, 0.88 - viscous], [([1.0, 0.0, 1.0], 0.01), ([0.0, 1.0, 0.0], 0.002)])
    (one,) = found.combinations
    assert one.expression == "Fv_joint1 + kd_joint1"
    assert one.value == pytest.approx(0.88)
    assert one.std == pytest.approx(0.01, rel=0.01)
    shown = standing(found, unknowns)
    assert shown == {"Fv_joint1": Standing.CONFOUNDED, "kd_joint1": Standing.CONFOUNDED, "Fc_joint1": Standing.DETERMINED}


def test_a_bound_counts_what_is_not_known_of_the_others():
    """Viscous friction at zero, beside a delay that looks like it and may be 20 ms: with 40 N m/rad it may be 0.8 N m s/rad."""
    unknowns = [FV, DELAY]
    found = decided(unknowns, [0.0, 0.0006], [([1.0, 40.0], 0.01), ([0.0, 1.0], 0.01)])
    assert standing(found, unknowns)["Fv_joint1"] == Standing.UNSEEN
    assert found.below[0] == pytest.approx(2.0 * 0.4, rel=0.05)
    # Nothing at all is known of the delay: then no number bounds the friction.
    assert np.isinf(decided(unknowns, [0.0, 0.0006], [([1.0, 40.0], 0.01)]).below[0])


def test_all_torque_by_one_factor_leaves_ratios():
    """kd and friction together over kp; an inertia that a delay imitates, with the delay beside it."""
    values = np.array([20.0, 0.4, 0.3, 0.1])
    unknowns = [KP, KD, FV, FC]
    found = decided(unknowns, values, [([-0.7 / 20.0, 1.0, 1.0, 0.0], 0.01), ([-0.1 / 20.0, 0.0, 0.0, 1.0], 0.002)])
    told = {c.expression: c.value for c in found.combinations}
    assert told == {"(Fv_joint1 + kd_joint1) / kp_joint1": pytest.approx(0.035), "Fc_joint1 / kp_joint1": pytest.approx(0.005)}
    inertia = Unknown("Ia_joint1", "kg m^2", "armature", 0)
    unknowns, values = [KP, inertia, DELAY], np.array([20.0, 0.02, 0.001])
    found = decided(unknowns, values, [([-0.001, 1.0, 2.0], 1e-3), ([0.0, 0.0, 1.0], 0.05)])
    (one,) = found.combinations
    assert one.expression == "Ia_joint1 / kp_joint1 + 0.1 delay"
    assert one.value == pytest.approx(0.02 / 20.0 + 0.1 * 0.001)


def test_a_real_log_prints_no_combination_that_it_does_not_determine(data_folder):
    """The AK80's stiff log, with friction that follows the drive's torque: kp in proportion to kd."""
    folder = data_folder / "actuators/ak80_pendulum"
    robot = ident.Robot.from_urdf(folder / "ak80_pendulum.urdf")
    law = ident.drives.DriveLaw.of(
        robot, kp="identify", kd="identify", effort_limit=12.0, gear_loss="identify", by_log={"*stiff*": {"feed_forward": 0.0}}
    )
    model = robot.rigid_body()
    for name in run.DRIVE:
        model = model + ident.make_effect(name)
    logs = ident.read_logs([str(folder / "ak80_sysid_stiff.csv.gz")], robot)
    fit = fit_drives(LogSet(tuple(logs)), model, law)
    numbers = re.findall(r"(\S*\d) ± (\S+)", fit.summary())
    assert numbers
    for value, std in numbers:
        assert float(std) <= 0.31 * abs(float(value)), (value, std)
    assert "kp_joint1 / kd_joint1" in fit.summary()
