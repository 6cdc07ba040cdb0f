"""The built-in PUMA 560 against the published theory: base parameters, drive, payloads, tables."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import ident
from ident.effects.motion import Motion
from ident.physical import published_subject
from ident.robots import declared_drive, drive_parameters, nominal_values, payloads, published_tables, robot_folder

CLUSTERS = ((0,), (1, 2), (3,), (4,), (5,))  # links between which the axis turns by 90 degrees
ARMS = {1: (0.432, -0.15), 3: (0.0, 0.433)}  # link index → Lx, Lz; all others 0


def base_map(arms=ARMS) -> tuple[list[str], np.ndarray]:
    """Theorem 2.3.1 (z_1 parallel to g, Q = 1) as names and the matrix (36, 60) over link parameters."""
    index = {s: i for i, s in enumerate(("m", "x", "y", "z", "xx", "xy", "yy", "xz", "yz", "zz"))}

    def unit(link: int, symbol: str) -> np.ndarray:
        row = np.zeros(60)
        row[10 * link + index[symbol]] = 1
        return row

    L = [arms.get(i, (0.0, 0.0)) for i in range(6)]
    M = [sum((unit(j, "m") for j in range(i, 6)), np.zeros(60)) for i in range(7)]
    R = [{"x": unit(i, "x") + L[i][0] * M[i + 1], "y": unit(i, "y"), "z": unit(i, "z") + L[i][1] * M[i + 1]} for i in range(6)]
    J = []
    for i, (x, z) in enumerate(L):
        shift = {"xx": z * z, "yy": x * x + z * z, "zz": x * x, "xz": -x * z, "xy": 0.0, "yz": 0.0}
        J.append({k: unit(i, k) + s * M[i + 1] for k, s in shift.items()})
    names, rows = [], []
    for d, cluster in enumerate(CLUSTERS):
        for i in cluster:
            after = [j for j in cluster if j > i]
            RZ = sum((R[j]["z"] for j in after), np.zeros(60))
            following = CLUSTERS[d + 1] if i == cluster[-1] and d + 1 < len(CLUSTERS) else ()
            RZB = sum((R[j]["z"] for j in following), np.zeros(60))
            JYB = sum(
                (J[j]["yy"] + 2 * L[j][1] * sum((R[s]["z"] for s in following if s > j), np.zeros(60)) for j in following), np.zeros(60)
            )
            x, z = L[i]
            entries = {f"J{i + 1}z": J[i]["zz"] + JYB}
            if i > 0:
                entries |= {
                    f"J{i + 1}(x-y)": J[i]["xx"] - J[i]["yy"] + JYB,
                    f"J{i + 1}xy": J[i]["xy"] + x * RZB,
                    f"J{i + 1}xz": J[i]["xz"] - x * RZ,
                    f"J{i + 1}yz": J[i]["yz"] + z * RZB,
                    f"R{i + 1}x": R[i]["x"],
                    f"R{i + 1}y": R[i]["y"] - RZB,
                }
            names += entries
            rows += entries.values()
    return names, np.array(rows)


@pytest.fixture(scope="module")
def robot():
    return ident.load_robot("puma560")


@pytest.fixture(scope="module")
def model(robot):
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


def motion(robot, n=300, seed=0):
    rng = np.random.default_rng(seed)
    return Motion.of(robot, rng.uniform(-3, 3, (n, 6)), rng.normal(size=(n, 6)), 5 * rng.normal(size=(n, 6)))


def scaled(columns):
    stack = columns.reshape(-1, columns.shape[-1])
    norm = np.linalg.norm(stack, axis=0)
    return stack / np.where(norm > 1e-12 * norm.max(), norm, np.inf)  # what is round-off stays nothing


def test_joints_and_frames(robot):
    assert robot.joint_names == tuple(f"joint{i}" for i in range(1, 7))
    twist = np.degrees(np.arccos(np.clip(robot.tree.rotation[:, 2, 2], -1, 1)))
    assert twist == pytest.approx([0, 90, 0, 90, 90, 90], abs=1e-12)
    assert robot.tree.translation == pytest.approx(np.array([[0, 0, 0], [0, 0, 0], [0.432, 0, -0.15], [0, 0, 0], [0, 0, 0.433], [0, 0, 0]]))
    assert robot.notes == ()


def test_nominal_base_parameters_are_the_published_consistent_set(robot):
    names, B = base_map()
    k = np.diag(robot.transmission.K)
    h = drive_parameters("puma560").values["Ia"]
    found = dict(zip(names, B @ robot.nominal, strict=True))
    found["J1z"] += h[0] / k[0] ** 2
    found["J2z"] += h[1] / k[1] ** 2
    wanted = json.loads((robot_folder("puma560") / "tables.json").read_text())["nominal"]["values"]
    assert len(found) == 36
    for name, value in found.items():
        assert value == pytest.approx(wanted[name], abs=1e-9), name


def test_closed_form_spans_the_regressor(robot):
    _, B = base_map()
    Y = robot.rigid_body().columns(motion(robot)).reshape(-1, 60)
    assert np.linalg.matrix_rank(B) == 36
    assert np.linalg.matrix_rank(scaled(Y.reshape(-1, 6, 60)), tol=1e-9) == 36
    assert np.abs(Y - Y @ np.linalg.pinv(B) @ B).max() < 1e-11 * np.abs(Y).max()


def test_thirty_six_and_sixteen(robot, model):
    _, B = base_map()
    m = motion(robot)
    Y = robot.rigid_body().columns(m) @ np.linalg.pinv(B)
    drive = model.columns(m)[:, :, 60:]
    s = np.linalg.svd(scaled(np.concatenate([Y, drive], axis=2)), compute_uv=False)
    assert len(s) == 54
    assert s[51] > 1e-3 * s[0]
    assert s[52] < 1e-13 * s[0]
    nine = motion(robot, 9, seed=3)
    columns = np.concatenate([robot.rigid_body().columns(nine) @ np.linalg.pinv(B), model.columns(nine)[:, :, 60:]], axis=2)
    assert np.linalg.matrix_rank(scaled(columns), tol=1e-9) == 52
    # Nine samples suffice, eight have as many rows as six joints give them; with diagonal gears as many parameters.
    assert np.linalg.matrix_rank(scaled(columns[:8]), tol=1e-9) == 48
    diagonal = robot.with_transmission(ident.Transmission(np.diag(np.diag(robot.transmission.K)), np.zeros(6), "motor"))
    same = diagonal.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    assert np.linalg.matrix_rank(scaled(same.columns(motion(diagonal))), tol=1e-9) == 52


def test_torque_agrees_with_pinocchio(robot, model):
    values = nominal_values(model)
    m = motion(robot, 20)
    tau = model.torque(m, values)
    drive = drive_parameters("puma560").values
    data = robot.model.createData()
    K = robot.transmission.K
    for i in range(20):
        link = pin.rnea(robot.model, data, m.joint.q[i], m.joint.dq[i], m.joint.ddq[i])
        motor = np.linalg.solve(K, m.joint.dq[i]), np.linalg.solve(K, m.joint.ddq[i])
        own = drive["Ia"] * motor[1] + drive["Fv"] * motor[0] + drive["Fc"] * np.sign(motor[0])
        assert tau[i] == pytest.approx(K.T @ link + own, rel=1e-11, abs=1e-12)


def test_transmission_is_the_printed_one(robot):
    """Equation (3.5) of Yoshida (1995), number by number, with the signs."""
    printed = {(1, 1): 1.60e-2, (2, 2): 9.26e-3, (3, 3): 1.86e-2, (4, 4): -1.32e-2, (5, 5): -1.39e-2, (6, 6): -1.30e-2}
    printed |= {(5, 4): 1.80e-4, (6, 4): 1.40e-4, (6, 5): 2.51e-3}
    K = robot.transmission.K
    assert robot.transmission.measured == "motor"
    assert {(i + 1, j + 1): K[i, j] for i, j in zip(*np.nonzero(K), strict=True)} == printed


def test_load_is_the_printed_one():
    """Section 3.2 of Yoshida (1995): 1.6 kg at (-7, 7, 11) cm; inertia about the origin of frame 6 as elements of the matrix."""
    bare, loaded = (ident.load_robot("puma560", payload=p) for p in ("none", "1.6kg"))
    load = (loaded.nominal - bare.nominal).reshape(6, 10)[5]
    printed = {"m": 1.6, "mx": 1.6 * -0.07, "my": 1.6 * 0.07, "mz": 1.6 * 0.11}
    printed |= {"Ixx": 3.67e-2, "Ixy": 7.59e-3, "Iyy": 3.67e-2, "Ixz": 1.23e-2, "Iyz": -1.23e-2, "Izz": 2.87e-2}
    assert load == pytest.approx(list(printed.values()), abs=1e-14)
    assert np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(load).toMatrix()).min() > 0


def test_verified_verdicts_on_the_published_tables(robot):
    """Smallest eigenvalues 0.0868, -1.235, 0.1695 kg m^2 at configurations found by an independent search."""
    tables, model = (
        published_tables("puma560"),
        robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb(),
    )
    verified = {
        "1": (0.0868, (97, -161, 31, 120, 140)),
        "2": (-1.235, (179, -85, 125, 104, -31)),
        "3": (0.1695, (-118, 108, 175, -169, 130)),
    }
    for number, (lowest, degrees) in verified.items():
        values = published_subject(robot, tables[number].values).values
        H = model.joint_inertia(np.radians([[0, *degrees]]), model.base.expand(values))[0]
        assert np.linalg.eigvalsh((H + H.T) / 2)[0] == pytest.approx(lowest, abs=6e-4)


def test_one_direction_alone_leaves_what_was_published_at_constant_velocity(robot):
    """(3.12) neglects the coupled gears: with the values of table 1 and 200 rad/s the moving wrist leaves 1e-4 and 8e-4 N m at motors 4
    and 5; half the difference of both directions leaves nothing."""
    names, rows = base_map()
    table = published_tables("puma560")["1"].values
    links = np.linalg.pinv(rows) @ [table[name] for name in names]
    model, K = robot.rigid_body(), robot.transmission.K
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (400, 6))

    def torque(speed: np.ndarray) -> np.ndarray:
        still = np.zeros_like(q)
        motion = Motion.of(robot, q, still + K @ speed, still, np.arange(len(q)) * 0.005)
        return model.torque(motion, links)

    left = np.zeros(6)
    for j, speed in enumerate(200.0 * np.eye(6)):
        left[j] = np.abs(torque(speed) - torque(0 * speed))[:, j].max()
        np.testing.assert_allclose(torque(speed)[:, j], torque(-speed)[:, j], atol=1e-12)
    np.testing.assert_allclose(left[[3, 4]], [1.3e-4, 7.9e-4], rtol=0.05)
    np.testing.assert_allclose(left[[0, 1, 2, 5]], 0.0, atol=1e-12)


def test_neglecting_the_coupling_costs_what_was_published(robot, model):
    """Same motor motion: 11 to 14 % rms on the wrist without any coupling, 1 to 2 % with k65 alone."""
    values, m = nominal_values(model), motion(robot, 2000)
    tau = model.torque(m, values)
    K = robot.transmission.K

    def error(other):
        fake = robot.with_transmission(ident.Transmission(other, np.zeros(6), "motor"))
        back = [a @ other.T for a in (m.motor.q, m.motor.dq, m.motor.ddq)]
        terms = fake.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
        return np.linalg.norm(terms.torque(Motion.of(fake, *back), values) - tau, axis=0) / np.linalg.norm(tau, axis=0)

    diagonal = np.diag(np.diag(K))
    assert np.all((error(diagonal)[3:] > 0.07) & (error(diagonal)[3:] < 0.14))
    only = diagonal.copy()
    only[5, 4] = K[5, 4]
    assert np.all(error(only)[3:] < 0.02)
    # By k65 joint 6 turns 0.57 rad with half a turn of joint 5.
    assert np.pi * K[5, 4] / abs(K[4, 4]) == pytest.approx(0.57, abs=0.005)


@pytest.mark.parametrize("payload", [None, *payloads("puma560")])
def test_every_link_is_physically_consistent(payload):
    for link in ident.load_robot("puma560", payload=payload).nominal.reshape(6, 10):
        assert np.linalg.eigvalsh(pin.PseudoInertia.FromDynamicParameters(link).toMatrix()).min() > 0


def test_payload_is_a_load_at_its_place():
    bare, loaded = (ident.load_robot("puma560", payload=p) for p in ("none", "1.6kg"))
    load = (loaded.nominal - bare.nominal).reshape(6, 10)
    assert not load[:5].any()
    assert ident.load_robot("puma560", payload="published").nominal == pytest.approx(ident.load_robot("puma560").nominal, abs=0)
    assert loaded.nominal[50:54] == pytest.approx(ident.load_robot("puma560").nominal[50:54], abs=1e-12)


def test_unknown_payload():
    with pytest.raises(ident.ConfigurationError, match=r"unknown payload 'nonne'; did you mean 'none'"):
        ident.load_robot("puma560", payload="nonne")


def test_published_tables_are_complete():
    tables = published_tables("puma560")
    assert list(tables) == ["1", "2", "3"]
    names, _ = base_map()
    wanted = {*names, *(f"h{i}" for i in range(3, 7)), *(f"{s}{i}" for s in "bc" for i in range(1, 7))}
    for table in tables.values():
        assert set(table.values) == wanted
        assert len(wanted) == 52
        assert set(table.units) == wanted
        assert set(table.doubts) <= wanted
    assert [tables["3"].values[n] for n in ("J3yz", "J4yz", "J5yz", "J6yz", "J2xy")] == [-1.75e-2, -6.92e-3, 2.32e-3, -1.15e-2, -1.12e-2]
    assert tables["1"].units["b3"] == "N m s/rad"


def test_published_tables_agree_with_the_record(data_folder: Path):
    record = json.loads((data_folder / "puma560" / "published_tables.json").read_text())["tables"]
    for number, table in published_tables("puma560").items():
        assert dict(table.values) == {n: v["value"] for n, v in record[f"table{number}"].items() if not n.startswith("_")}
    links = json.loads((data_folder / "puma560" / "consistent_near_table1.json").read_text())["links"]
    wanted = [link[s] for link in links for s in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
    assert ident.load_robot("puma560").nominal == pytest.approx(wanted, abs=1e-15)


def test_rigid_links_rule_out_the_published_sets():
    """J6z^2 >= J6(x-y)^2 + 4 J6xy^2 for any body; all three tables violate it, the nominal robot does not."""
    for table in published_tables("puma560").values():
        v = table.values
        assert v["J6z"] ** 2 < v["J6(x-y)"] ** 2 + 4 * v["J6xy"] ** 2
    nominal = json.loads((robot_folder("puma560") / "tables.json").read_text())["nominal"]["values"]
    assert nominal["J6z"] ** 2 > nominal["J6(x-y)"] ** 2 + 4 * nominal["J6xy"] ** 2


def test_declared_effects(robot):
    assert [e["name"] for e in declared_drive("puma560").effects] == ["rotor_inertia", "viscous", "coulomb"]


def test_nominal_values_follow_the_robot(model):
    values = dict(zip(model.names, nominal_values(model), strict=True))
    assert values["Ia_joint3"] == pytest.approx(3.12e-4)
    assert values["Fv_joint1"] == pytest.approx(8.63e-4)
    assert values["Fc_joint6"] == pytest.approx(2.25e-2)
    with_offset = model + ident.make_effect("offset")
    assert nominal_values(with_offset)[-6:] == pytest.approx(np.zeros(6), abs=0)
