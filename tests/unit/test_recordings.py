"""Recordings that name their channels otherwise are recognised by structure; the same motion is read from each."""

from __future__ import annotations

import bz2
import gzip
import json
import lzma
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident

Array = np.ndarray
N, RATE = 400, 100.0
STATE = "control_msgs/msg/JointTrajectoryControllerState"


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


#: Rates that recordings without a time were made with.
RATES = {"iiwa_sim_no_time": 100.0, "kinova_kortex_jsonl": 40.0, "aloha_hdf5": 50.0}
#: Recordings that must end in a question or a refusal, and what it has to hold.
ASKED = {
    "ros2_mcap_one_message": "one row of data",
    "robosuite_demo_hdf5": r'q7 = "states\[7\]", dq1 = "states\[8\]".*joint_torques\[0\]',
    "ur10e_headerless": 'q6 = "#6", dq1 = "#7"',
}


def wild(data_folder: Path) -> tuple[Path, list[dict[str, Any]]]:
    folder = data_folder / "logs_wild"
    if not folder.is_dir():
        pytest.skip("the collection of recordings is not here")
    return folder, json.loads((folder / "manifest.json").read_text())


def test_wild_recordings_are_read_as_they_are(data_folder: Path) -> None:
    """Against what is known of each: samples, time, which channels are there, and what was desired."""
    folder, manifest = wild(data_folder)
    read = 0
    for about in manifest:
        name, check = about["id"], about["check"]
        if name in ASKED:
            continue
        logs = ident.read_logs(folder / about["input"], rate_hz=RATES.get(name))
        log = logs[0]
        told = [log.joint_names.index(j) for j in about["joints"]] if set(about["joints"]) <= set(log.joint_names) else slice(None)
        assert log.n == len(about["joints"]), name
        assert len(log) == check["samples_used"], name
        np.testing.assert_allclose(log.q[0][told], check["q_first_rad"], atol=1e-6, err_msg=name)
        np.testing.assert_allclose(log.q[-1][told], check["q_last_rad"], atol=1e-6, err_msg=name)
        if name not in RATES and check["t_first_s"] > 0.0:
            assert log.t[0] == pytest.approx(check["t_first_s"], abs=1e-6), name
            assert log.duration == pytest.approx(check["t_last_s"] - check["t_first_s"], abs=1e-6), name
        assert (log.dq is not None) == bool(about["dq"]["channels"]), name
        unit = about["effort"]["unit"]
        assert list(log.tau) == ([] if unit is None else ["current" if unit.endswith("A") else "joint"]), name
        if unit == "Nm":
            np.testing.assert_allclose(log.tau["joint"][0][told], check["effort_first_file_unit"], rtol=1e-5, err_msg=name)
            np.testing.assert_allclose(log.tau["joint"][-1][told], check["effort_last_file_unit"], rtol=1e-5, err_msg=name)
        elif unit is not None:
            one = {"A": 1.0, "mA": 1e-3, "2.69 mA": 2.69e-3}[unit]
            np.testing.assert_allclose(log.tau["current"][0], one * np.array(check["effort_first_file_unit"]), rtol=1e-5, err_msg=name)
        if about["reference"] and name not in ("pendulum_two_files", "semicolon_decimal_comma"):
            wanted = np.stack([log.extra[f"q_ref{j + 1}"] for j in range(log.n)], axis=1)
            gap = np.abs(wanted - log.q)[np.isfinite(wanted).all(axis=1)]
            assert gap.size, name
            assert np.sqrt(np.mean(gap**2)) < 0.3 * np.std(log.q - log.q.mean(axis=0)) + 1e-2, name
        read += 1
    assert read == 22


@pytest.mark.parametrize("name", ["iiwa_sim_no_time", "kinova_kortex_jsonl", "aloha_hdf5"])
def test_wild_recordings_without_a_time_ask_for_the_rate(data_folder: Path, name: str) -> None:
    folder, manifest = wild(data_folder)
    (about,) = [x for x in manifest if x["id"] == name]
    with pytest.raises(ident.DataError, match="rate_hz = "):
        ident.read_logs(folder / about["input"])


@pytest.mark.parametrize("name", sorted(ASKED))
def test_wild_recordings_that_nobody_can_know_are_asked_about(data_folder: Path, name: str) -> None:
    folder, manifest = wild(data_folder)
    (about,) = [x for x in manifest if x["id"] == name]
    with pytest.raises(ident.DataError, match=ASKED[name]):
        ident.read_logs(folder / about["input"])


def test_what_is_proposed_for_a_table_without_names_reads_it(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    path = tmp_path / "a.csv"
    np.savetxt(path, np.column_stack([t + 7.0, q, dq, tau, 2 * tau]), delimiter=",")
    with pytest.raises(ident.DataError) as caught:
        ident.read_logs(path)
    said = re.search(r'under \[columns\] of a study file: (t = "#0".*?)\. Torque', str(caught.value))
    assert said is not None, caught.value
    columns = tomllib.loads("\n".join(said[1].split(", ")))
    assert len(columns) == 7
    log = ident.read_logs(path, columns=columns | {f"tau{j + 1}": f"#{j + 7}" for j in range(3)})[0]
    assert len(log) == N  # the first row is a sample
    np.testing.assert_allclose(log.q, q)
    np.testing.assert_allclose(log.tau["joint"], tau)


def hdf5(path: Path, arrays: dict[str, Array]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, a in arrays.items():
            file[name] = a
        file["observations/images/cam"] = np.zeros((N, 2, 2, 3), np.uint8)
    return path


def test_hdf5_of_one_recording_and_of_several(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    names = {"time": t, "observations/qpos": q, "observations/qvel": dq, "observations/torque": tau, "action": q + 0.01}
    log = is_the_motion(hdf5(tmp_path / "one.hdf5", names))
    np.testing.assert_allclose(log.extra["q_ref3"], q[:, 2] + 0.01)
    several = {f"data/demo_{k}/{name}": a + (0.0 if name == "time" else 0.1 * k) for k in (0, 2, 10) for name, a in names.items()}
    logs = ident.read_logs(hdf5(tmp_path / "several.hdf5", several))
    assert logs.names == ("data demo_0", "data demo_2", "data demo_10")
    for k, found in zip((0, 2, 10), logs, strict=True):
        np.testing.assert_allclose(found.q, q + 0.1 * k)
    np.testing.assert_allclose(ident.read_logs(tmp_path / "several.hdf5/data/demo_2")[0].q, q + 0.2)
    with pytest.raises(ident.DataError, match="no group 'data/demo_5'"):
        ident.read_logs(tmp_path / "several.hdf5/data/demo_5")


def test_matlab_structs_before_and_after_version_7_3(tmp_path: Path) -> None:
    """The later layout is written as MATLAB writes it: transposed, text as numbers, structs as groups, arrays of structs by reference."""
    h5py = pytest.importorskip("h5py")
    from scipy.io import savemat

    t, q, dq, tau = motion()
    signals = {"q_meas [deg]": np.rad2deg(q), "dq_meas [deg/s]": np.rad2deg(dq), "u_motor [Nm]": tau}
    structs = np.array([{"values": a, "label": name} for name, a in signals.items()], dtype=object)
    savemat(tmp_path / "old.mat", {"ScopeData": {"time": t, "signals": structs}, "tout": t[::2], "params": {"m": [0.6, 0.5]}})
    is_the_motion(tmp_path / "old.mat")
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        group = file.create_group("ScopeData")
        group["time"] = t[None, :]
        group["time"].attrs["MATLAB_class"] = np.bytes_("double")
        references = file.create_group("#refs#")
        kept: dict[str, list[Any]] = {"values": [], "label": []}
        for k, (name, a) in enumerate(signals.items()):
            values = references.create_dataset(f"v{k}", data=a.T)
            values.attrs["MATLAB_class"] = np.bytes_("double")
            label = references.create_dataset(f"l{k}", data=np.array([[ord(c)] for c in name], np.uint16))
            label.attrs["MATLAB_class"] = np.bytes_("char")
            kept["values"].append(values.ref)
            kept["label"].append(label.ref)
        parts = group.create_group("signals")
        for name, refs in kept.items():
            parts.create_dataset(name, data=np.array(refs, dtype=h5py.ref_dtype).reshape(1, -1), dtype=h5py.ref_dtype)
    with (tmp_path / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    is_the_motion(tmp_path / "new.mat")


def test_of_two_encoders_the_motors_counts_unless_it_counts_before_the_gear(tmp_path: Path) -> None:
    from scipy.io import savemat

    t, q, _, tau = motion()
    record = {"time_cont": t, "act_pos_se_deg": np.rad2deg(q).T, "act_torque_abs_nm": tau.T, "ref_pos_deg": np.rad2deg(q + 0.01).T}
    savemat(tmp_path / "a.mat", {"rec": record | {"act_pos_mot_deg": np.rad2deg(q + 0.001).T}})
    np.testing.assert_allclose(ident.read_logs(tmp_path / "a.mat")[0].q, q + 0.001)
    savemat(tmp_path / "b.mat", {"rec": record | {"act_pos_mot_deg": 80 * np.rad2deg(q).T}})
    np.testing.assert_allclose(ident.read_logs(tmp_path / "b.mat")[0].q, q)


def test_json_messages_of_actuators_within_one_turn(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    q = q + [0.0, 3.0, -2.0]
    rows = [
        {
            "stamp": float(t[k]) + 5.0,
            "base": {"state": "READY"},
            "actuators": [
                {"position": float(np.rad2deg(q[k, j]) % 360.0), "velocity": float(np.rad2deg(dq[k, j])), "torque": str(tau[k, j])}
                for j in range(3)
            ],
        }
        for k in range(N)
    ]
    path = tmp_path / "a.jsonl"
    path.write_text("\n".join(json.dumps(row) for row in rows))
    log = ident.read_logs(path)[0]
    np.testing.assert_allclose(log.q, q - 2 * np.pi * np.round(q[0] / (2 * np.pi)), atol=1e-9)
    np.testing.assert_allclose(log.dq, dq)
    np.testing.assert_allclose(log.tau["joint"], tau)
    with gzip.open(tmp_path / "b.json.gz", "wt") as file:
        file.write(json.dumps(rows))
    np.testing.assert_array_equal(ident.read_logs(tmp_path / "b.json.gz")[0].q, log.q)
    path.write_text(path.read_text() + "\n{broken")
    cut = ident.read_logs(path)[0]
    np.testing.assert_array_equal(cut.q, log.q)
    assert any(f"line {N + 1}, the last, is a truncated message" in note for note in cut.notes)
    path.write_text(path.read_text() + "\n")
    with pytest.raises(ident.DataError, match=f"line {N + 1} is not a JSON message"):
        ident.read_logs(path)


def test_json_joint_states_go_by_their_names(tmp_path: Path) -> None:
    t, q, dq, tau = motion()
    path = tmp_path / "a.jsonl"
    order = ["b", "c", "a"]
    lines = []
    for k in range(N):
        place = [order.index(x) for x in (order if k % 2 else sorted(order))]
        values = {word: [float(x[k, j]) for j in place] for word, x in (("position", q), ("velocity", dq), ("effort", tau))}
        lines.append(json.dumps({"t": float(t[k]), "name": [order[j] for j in place], **values}))
    path.write_text("\n".join(lines))
    log = ident.read_logs(path)[0]
    np.testing.assert_allclose(log.q[:, [log.joint_names.index(x) for x in order]], q)


@pytest.mark.parametrize("whole", [False, True])
def test_xml_telegrams(tmp_path: Path, whole: bool) -> None:
    t, q, _, tau = motion()
    rows = []
    for k in range(N):
        parts = [
            f"<{tag} " + " ".join(f'A{j + 1}="{x[k, j]:.9f}"' for j in range(3)) + "/>"
            for tag, x in (("AIPos", np.rad2deg(q)), ("ASPos", np.rad2deg(q + 0.002)), ("GearTorque", tau))
        ]
        rows.append(f'<Rob Type="KUKA"><RIst X="{k}.5"/>{"".join(parts)}<Delay D="0"/><IPOC>{123456 + round(1000 * t[k])}</IPOC></Rob>')
    text_of = "\n".join(rows)
    (tmp_path / "a.xml").write_text(f"<?xml version='1.0'?><log>{text_of}</log>" if whole else text_of)
    log = is_the_motion(tmp_path / "a.xml")
    np.testing.assert_allclose(log.extra["q_ref1"], q[:, 0] + 0.002, atol=1e-8)
    (tmp_path / "b.xml").write_text('<!DOCTYPE x [<!ENTITY a "b">]>' + text_of)
    with pytest.raises(ident.DataError, match="entities"):
        ident.read_logs(tmp_path / "b.xml")


@pytest.mark.parametrize("key", ["id", "joint"])
def test_long_tables_have_a_row_for_each_joint(tmp_path: Path, key: str) -> None:
    t, q, dq, tau = motion()
    labels = ["11", "12", "15"] if key == "id" else ["hip", "knee", "ankle"]
    lines = [f"time_s,{key},position,velocity,torque"]
    lines += [f"{t[k] + 0.001 * j:.6f},{labels[j]},{q[k, j]:.9f},{dq[k, j]:.9f},{tau[k, j]:.9f}" for k in range(N) for j in range(3)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    log = is_the_motion(tmp_path / "a.csv")
    assert [name.split()[-1] for name in log.joint_names] == labels


def test_counts_are_asked_about_unless_the_recorder_is_known(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    counts = np.round(q / (2 * np.pi) * 4096) + 2048
    path = text(tmp_path / "a.csv", ["t", *each("enc_pos_{}"), *each("torque_{}")], [t, *counts.T, *tau.T])
    with pytest.raises(ident.DataError, match="encoder counts"):
        ident.read_logs(path)
    current = np.round(tau / 2.69e-3)
    names = ["ms", *each("present_position_{}"), *each("present_current_{}"), *each("goal_position_{}")]
    log = ident.read_logs(text(tmp_path / "b.csv", names, [1000 * t, *counts.T, *current.T, *counts.T]))[0]
    np.testing.assert_allclose(log.q, q, atol=np.pi / 4096 + 1e-9)
    np.testing.assert_allclose(log.tau["current"], tau, atol=1.4e-3)
    np.testing.assert_allclose(log.extra["q_ref1"], log.q[:, 0])
    np.testing.assert_allclose(log.t[-1] - log.t[0], t[-1])


def test_channels_that_hold_only_zeros_are_not_measurements(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    zero = np.zeros_like(q)
    names = ["t", *each("q{}", 1), *each("dq{}", 1), *each("tau{}", 1)]
    log = ident.read_logs(text(tmp_path / "a.csv", names, [t, *q.T, *zero.T, *zero.T]))[0]
    assert log.dq is None
    assert not log.tau
    log = ident.read_logs(text(tmp_path / "b.csv", names, [t, *(zero + 1e-5 * q).T, *zero.T, *tau.T]))[0]
    assert log.dq is not None  # it stands still
    assert list(log.tau) == ["joint"]


def test_hands_are_left_out_where_no_robot_has_them(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    t, q, _, _ = motion(4)
    folder = tmp_path / "set"
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    for names in (["a_joint", "b_joint", "c_joint", "gripper"], {"motors": ["a_joint", "b_joint", "c_joint", "left_hand_thumb"]}):
        (folder / "meta/info.json").write_text(
            json.dumps({"features": {"observation.state": {"names": names}, "action": {"names": names}}})
        )
        # Version 3 of the data set keeps several episodes in a file, each with a time of its own.
        twice = {"timestamp": [*t, *t], "observation.state": [*q.tolist(), *(q + 1).tolist()], "action": [*q.tolist(), *q.tolist()]}
        parquet.write_table(pa.table(twice), folder / "data/chunk-000/file-000.parquet")
        logs = ident.read_logs(folder)
        assert len(logs) == 2
        np.testing.assert_allclose(logs[1].q, q[:, :3] + 1)
        assert logs[0].joint_names == ("a_joint", "b_joint", "c_joint")


def test_desired_motion_beside_in_another_file(tmp_path: Path) -> None:
    t, q, dq, tau = motion(1)
    names = ["time", "position", "velocity", "torque"]
    text(tmp_path / "data_measured.csv", names, [t, q[:, 0], dq[:, 0], tau[:, 0]])
    text(tmp_path / "data_desired.csv", names, [t + 1e-4, q[:, 0] + 0.02, dq[:, 0], tau[:, 0]])
    (log,) = ident.read_logs(tmp_path)
    np.testing.assert_allclose(log.q, q, atol=1e-8)
    known = np.isfinite(log.extra["q_ref1"])
    assert known.sum() == N - 1
    np.testing.assert_allclose(log.extra["q_ref1"][known], q[known, 0] + 0.02, atol=1e-3)


def test_desired_motion_in_another_order_of_joints(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    names = [
        "time",
        *[f"/joint_states/{x}/position" for x in "cab"],
        *[f"/joint_states/{x}/effort" for x in "cab"],
        *each("/ctl/reference/positions[{}]"),
    ]
    wanted = q[:, [1, 2, 0]] + 0.01  # the controller counts a, b, c
    log = ident.read_logs(text(tmp_path / "a.csv", names, [t, *q.T, *tau.T, *wanted.T]))[0]
    assert log.joint_names == ("c", "a", "b")
    for j in range(3):
        np.testing.assert_allclose(log.extra[f"q_ref{j + 1}"], q[:, j] + 0.01, atol=1e-8)


@pytest.mark.parametrize(
    "pattern", ["{what}_{joint}", "{joint} {what}", "{what}/{joint}", "{what}_{joint} [{unit}]", "{joint}_{what}_actual"]
)
@pytest.mark.parametrize("numbers", [False, True])
def test_names_of_joints_within_the_names_of_columns(tmp_path: Path, pattern: str, numbers: bool) -> None:
    """With the robot and alone; a number in some joints' names is not what counts them."""
    t, q, dq, tau = motion(6)
    robot = ident.load_robot("ur5")
    own = ["lift", "wrist_1", "wrist_2", "pan", "wrist_3", "elbow"] if numbers else ["slew", "boom_lift", "stick", "bucket", "tilt", "grab"]
    order = [2, 0, 5, 3, 1, 4]

    def recorded(joints: Sequence[str]) -> Path:
        names, columns = ["time"], [t]
        for what, unit, values in (("position", "deg", np.rad2deg(q)), ("velocity", "deg/s", np.rad2deg(dq)), ("torque", "Nm", tau)):
            names += [pattern.format(what=what, joint=joints[j], unit=unit) for j in order]
            columns += [values[:, j] for j in order]
        return text(tmp_path / "a.csv", [*names, "temperature_motor", "position_x"], [*columns, 0 * t + 30, 0 * t + 0.5])

    log = ident.read_logs(recorded(own))[0]
    assert log.joint_names == tuple(own[j] for j in order)
    np.testing.assert_allclose(log.q, q[:, order], atol=1e-6)
    np.testing.assert_allclose(log.tau["joint"], tau[:, order], atol=1e-6)
    of_robot = ident.read_logs(recorded(robot.joint_names), robot)[0]
    np.testing.assert_allclose(of_robot.q, q, atol=1e-6)


def test_desired_motion_goes_by_the_joints_names_however_near_another_joint_is(tmp_path: Path) -> None:
    t, q, _, tau = motion()
    names = ["time", *[f"position_{x}" for x in ("hip", "knee", "ankle")], *[f"torque_{x}" for x in ("hip", "knee", "ankle")]]
    names += [f"target_position_{x}" for x in ("ankle", "hip", "knee")]
    wanted = q[:, [2, 0, 1]]
    columns = [t, *q.T, *tau.T, *wanted.T]
    log = ident.read_logs(text(tmp_path / "a.csv", names, columns))[0]
    np.testing.assert_allclose(np.stack([log.extra[f"q_ref{j}"] for j in (1, 2, 3)], axis=1), q, atol=1e-8)
    # Named otherwise than it moves: the name counts.
    log = ident.read_logs(text(tmp_path / "b.csv", names, [t, *q.T, *tau.T, *q.T]))[0]
    np.testing.assert_allclose(log.extra["q_ref3"], q[:, 0], atol=1e-8)


def test_a_bag_with_two_publishers_and_a_controllers_state(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    point = "trajectory_msgs/JointTrajectoryPoint"
    store.register(get_types_from_msg(f"std_msgs/Header header\nstring[] joint_names\n{point} reference\n{point} feedback", STATE))
    types = store.types
    t, q, dq, tau = motion()

    def header(k: float) -> Any:
        nanoseconds = round(1e9 * k)
        stamp = types["builtin_interfaces/msg/Time"](sec=100 + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="")

    def state(k: int, names: list[str], at: list[int], shift: float = 0.0) -> Any:
        values = [np.array([x[k, j] for j in at]) for x in (q, dq, tau)]
        return store.serialize_cdr(types["sensor_msgs/msg/JointState"](header(t[k] + shift), names, *values), "sensor_msgs/msg/JointState")

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        joints = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        control = writer.add_connection("/ctl/controller_state", STATE, typestore=store)
        for k in range(N):
            writer.write(joints, 10**12 + 10 * k, state(k, ["arm_b", "arm_a"], [1, 0]))
            if k % 2 == 0:
                writer.write(joints, 10**12 + 10 * k + 1, state(k, ["lift"], [2], 0.001))
                empty, span = np.array([]), types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
                made = types["trajectory_msgs/msg/JointTrajectoryPoint"]
                wanted = made(q[k, [0, 1]] + 0.01, dq[k, [0, 1]], empty, empty, span)
                told = types[STATE](header(t[k]), ["arm_a", "arm_b"], wanted, made(empty, empty, empty, empty, span))
                writer.write(control, 10**12 + 10 * k + 2, store.serialize_cdr(told, STATE))
    log = ident.read_logs(tmp_path / "bag", missing="gap")[0]
    at = {name: k for k, name in enumerate(log.joint_names)}
    rows = np.searchsorted(t, log.t - 100.0 - 1e-6)
    np.testing.assert_allclose(log.q[:, [at["arm_a"], at["arm_b"]]], q[rows, :2], atol=1e-12)
    np.testing.assert_allclose(log.q[:, at["lift"]], q[rows, 2], atol=0.02)
    wanted = log.extra[f"q_ref{at['arm_b'] + 1}"]
    np.testing.assert_allclose(wanted[np.isfinite(wanted)], q[rows, 1][np.isfinite(wanted)] + 0.01, atol=1e-3)


@pytest.mark.parametrize("packed", ["", "gz", "bz2", "xz", "zst"])
def test_packed_text(tmp_path: Path, packed: str) -> None:
    t, q, dq, tau = motion()
    plain = text(tmp_path / "a.csv", ["t", *each("q{}", 1), *each("dq{}", 1), *each("tau{}", 1)], [t, *q.T, *dq.T, *tau.T])
    if packed == "zst":
        pa = pytest.importorskip("pyarrow")
        with pa.CompressedOutputStream(str(tmp_path / "a.csv.zst"), "zstd") as out:
            out.write(plain.read_bytes())
    elif packed:
        module = {"gz": gzip, "bz2": bz2, "xz": lzma}[packed]
        (tmp_path / f"a.csv.{packed}").write_bytes(module.compress(plain.read_bytes()))
    is_the_motion(tmp_path / f"a.csv{'.' if packed else ''}{packed}")


def test_a_format_of_ones_own(tmp_path: Path) -> None:
    from ident.logs import LogFormat, Stored, register_log_format

    t, q, dq, tau = motion()
    (tmp_path / "a.ownrig").write_bytes(np.column_stack([t, q, dq, tau]).tobytes())

    def read(path: Path) -> Stored:
        table = np.frombuffer(path.read_bytes()).reshape(-1, 10)
        columns = ["t", *each("pos {}", 1), *each("speed {}", 1), *each("torque {}", 1)]
        return Stored(dict(zip(columns, table.T, strict=True)))

    register_log_format(LogFormat("own rig", lambda path, start: path.suffix == ".ownrig", read))
    is_the_motion(tmp_path / "a.ownrig")


def test_a_recorder_of_ones_own(tmp_path: Path) -> None:
    from ident.logs import add_recorders

    t, q, _, tau = motion()
    known = tmp_path / "rig.toml"
    known.write_text(
        '[[recorder]]\nname = "our rig"\ncolumns = ["rigpos_0"]\ncounts = 1000\ncentre = 500\neffort = "current"\n'
        'effort_scale = 0.01\nchannels = { q = "rigpos_{}" }\n'
    )
    add_recorders(known)
    counts = np.round(q / (2 * np.pi) * 1000) + 500
    log = ident.read_logs(text(tmp_path / "a.csv", ["t", *each("rigpos_{}"), *each("torque_{}")], [t, *counts.T, *(100 * tau).T]))[0]
    np.testing.assert_allclose(log.q, q, atol=np.pi / 1000 + 1e-9)
    np.testing.assert_allclose(log.tau["current"], tau, atol=1e-6)
    assert log.recording is not None
    assert log.recording.recorder == "our rig"
    known.write_text('[[recorder]]\nname = "our rig"\ncolumns = ["a"]\neffort = "torque"\n')
    with pytest.raises(ident.ConfigurationError, match="effort"):
        add_recorders(known)
