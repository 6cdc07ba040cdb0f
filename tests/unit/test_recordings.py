"""Recordings that name their channels otherwise are recognised by structure; the same motion is read from each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N, RATE = 400, 100.0


def motion(n: int = 3) -> tuple[Array, Array, Array, Array]:
    t = np.arange(N) / RATE
    w = 1.0 + 0.7 * np.arange(n)
    q = 0.9 * np.sin(np.outer(t, w) + np.arange(n))
    dq = 0.9 * w * np.cos(np.outer(t, w) + np.arange(n))
    tau = 3.0 * np.sin(np.outer(t, 2 * w)) + 0.5 + 0.01 * np.random.default_rng(0).normal(size=(N, n))
    return t, q, dq, tau


def text(
    path: Path, names: list[str], columns: list[Array], delimiter: str = ",", decimal: str = ".", units: list[str] | None = None
) -> Path:
    rows = [delimiter.join(names)] + ([delimiter.join(units)] if units else [])
    table = np.stack(columns, axis=1)
    rows += [delimiter.join(f"{x:.9g}".replace(".", decimal) for x in row) for row in table]
    path.write_bytes(("\n".join(rows) + "\n").encode("cp1252"))
    return path


def each(pattern: str, first: int = 0, n: int = 3) -> list[str]:
    return [pattern.format(first + j) for j in range(n)]


def is_the_motion(path: Path, **options: float) -> ident.Log:
    t, q, dq, tau = motion()
    log = ident.read_logs(path, **options)[0]
    np.testing.assert_allclose(log.t - log.t[0], t, atol=1e-6)
    np.testing.assert_allclose(log.q, q, atol=1e-6)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, dq, atol=1e-5)
    (side,) = log.tau
    np.testing.assert_allclose(log.tau[side], tau, atol=1e-6)
    return log


@pytest.mark.parametrize("delimiter", [",", " ", ";", "\t"])
def test_measured_beside_wanted_and_model(tmp_path: Path, delimiter: str) -> None:
    t, q, dq, tau = motion()
    names = [
        "timestamp",
        *each("target_q_{}"),
        *each("actual_q_{}"),
        *each("actual_qd_{}"),
        *each("actual_current_{}"),
        *each("target_moment_{}"),
        "mode",
    ]
    log = is_the_motion(text(tmp_path / "a.csv", names, [t + 40.0, *(q + 0.01).T, *q.T, *dq.T, *tau.T, *(2 * tau).T, 0 * t], delimiter))
    assert list(log.tau) == ["current"]
    np.testing.assert_allclose(log.extra["q_ref2"], q[:, 1] + 0.01, atol=1e-6)


def test_brackets_dots_milliseconds_and_three_torques(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    names = ["time", *each("state.q[{}]"), *each("state.q_d[{}]"), *each("state.dq[{}]"), *each("state.tau_J[{}]")]
    names += [*each("state.tau_ext_hat_filtered[{}]"), *each("cmd.tau_J_d[{}]"), *each("cmd.dq_d[{}]")]
    zero = np.zeros_like(tau)
    is_the_motion(
        text(tmp_path / "a.csv", names, [1000 * t + 1523000, *q.T, *(q + 0.02).T, *dq.T, *tau.T, *(0.1 * tau).T, *(3 * tau).T, *zero.T])
    )


def test_degrees_and_axes_that_are_all_zero(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    names = ["TIMESTAMP", *each("FB_POS_RJ{}", 1), *each("FB_POS_EJ{}", 1), *each("FB_TORQUE_RJ{}", 1)]
    path = text(tmp_path / "b.csv", names, [t, *np.rad2deg(q).T, *np.zeros_like(q).T, *tau.T])
    is_the_motion(path)


def test_a_spreadsheet_with_units_decimal_commas_and_another_encoding(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    names = ["Zeit", *each("Winkel {}", 1), *each("Drehzahl {}", 1), *each("Moment {}", 1), "Prüfstand"]
    units = ["s", *["°"] * 3, *["U/min"] * 3, *["Nm"] * 3, "°C"]
    columns = [t, *np.rad2deg(q).T, *(dq * 60 / (2 * np.pi)).T, *tau.T, 0 * t]
    is_the_motion(text(tmp_path / "a.csv", names, columns, ";", ",", units))


def test_names_of_joints_behind_topics_in_the_robots_order(tmp_path: Path) -> None:
    t, q, dq, tau = motion(4)
    robot = ident.load_robot("scara")
    order = [2, 0, 3, 1]
    names = ["time"]
    columns = [t]
    for word, values in (("position", q), ("velocity", dq), ("effort", tau)):
        names += [f"/joint_states/{robot.joint_names[j]}/{word}" for j in order]
        columns += [values[:, j] for j in order]
    log = ident.read_logs(text(tmp_path / "a.csv", names, columns), robot)[0]
    np.testing.assert_allclose(log.q, q, atol=1e-6)
    np.testing.assert_allclose(log.tau[robot.transmission.measured.value], tau, atol=1e-6)


def test_arrays_with_an_unfilled_end(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    tail = [np.concatenate([a, np.zeros((50, *a.shape[1:]))]) for a in (t + 1.0, q, dq, tau)]
    np.savez(
        tmp_path / "a.npz", tstamps=tail[0], q_mes=tail[1], v_mes=tail[2], torquesFromCurrent=tail[3], baseOrientation=np.zeros((450, 4))
    )
    assert len(is_the_motion(tmp_path / "a.npz")) == N


def test_parquet_with_lists_of_a_dataset(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    t, q, _, _ = motion()
    folder = tmp_path / "set/data/chunk-000"
    folder.mkdir(parents=True)
    table = pa.table({"timestamp": t, "observation.state": q.tolist(), "action": (q + 0.05).tolist()})
    parquet.write_table(table, folder / "episode_000000.parquet")
    log = ident.read_logs(tmp_path / "set")[0]
    np.testing.assert_allclose(log.q, q)
    np.testing.assert_allclose(log.extra["q_ref1"], q[:, 0] + 0.05)
    assert not log.tau


def test_bags_order_messages_by_stamp_and_values_by_name(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    t, q, dq, tau = motion()
    for plugin in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
        path = tmp_path / plugin.name
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            topic = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
            for k in np.random.default_rng(3).permutation(N).tolist():
                order = [0, 1, 2] if k % 2 else [2, 0, 1]
                nanoseconds = round(1e9 * t[k])
                stamp = types["builtin_interfaces/msg/Time"](sec=100 + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
                header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
                values = [np.array([x[k, j] for j in order]) for x in (q, dq, tau)]
                message = types["sensor_msgs/msg/JointState"](header, [f"j{j}" for j in order], *values)
                writer.write(topic, 10**12 + k, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        log = ident.read_logs(path)[0]
        np.testing.assert_allclose(log.t - log.t[0], t, atol=1e-6)
        np.testing.assert_allclose(np.sort(log.q, axis=1), np.sort(q, axis=1), atol=1e-12)


def test_without_a_time_the_rate_is_asked_for(tmp_path: Path) -> None:
    _, q, _, tau = motion()
    path = text(tmp_path / "a.csv", [*each("Joint{}_Pos", 1), *each("Joint{}_Force", 1)], [*q.T, *tau.T])
    with pytest.raises(ident.DataError, match="rate_hz"):
        ident.read_logs(path)
    is_the_motion(path, rate_hz=RATE)


def test_wild_recordings_are_read_as_they_are(data_folder: Path) -> None:
    """Against what is known of each: first and last sample, and time. Those that must be refused or asked about are left out."""
    folder = data_folder / "logs_wild"
    if not folder.is_dir():
        pytest.skip("the collection of recordings is not here")
    known = {x["id"]: x for x in json.loads((folder / "manifest.json").read_text())}
    plain = (
        "ros2_db3_ur10", "ros1_bag_fake_joints", "rostopic_echo_csv", "ur_rtde_record_standstill",
        "ur_rtde_file_recording",
        "libfranka_log", "kuka_fri_pyfri", "abb_egm_log", "semicolon_decimal_comma", "unitree_lowstate_csv", "solo_logger_npz",
    )  # fmt: skip
    for name in plain:
        about = known[name]["check"]
        log = ident.read_logs(folder / known[name]["input"])[0]
        np.testing.assert_allclose(log.q[0], about["q_first_rad"], atol=1e-5, err_msg=name)
        np.testing.assert_allclose(log.q[-1], about["q_last_rad"], atol=1e-5, err_msg=name)
        assert log.duration == pytest.approx(about["t_last_s"] - about["t_first_s"], abs=1e-3), name
