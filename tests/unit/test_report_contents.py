"""What the reports of results hold, against numbers made in another way."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

import ident
from ident.drawing.document import BlockKind, Figure, Table, read_report
from ident.drawing.html import to_html
from ident.reporting import report_of
from ident.reporting.robot import joint_frames, robot_figure

ARM = """<robot name="arm"><link name="base"/>
  <link name="rod"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.0008" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0.1 0 0.05"/><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="rod"/><origin xyz="0 0 0.3" rpy="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="20" velocity="4"/></joint>
  <joint name="j2" type="revolute"><parent link="rod"/><child link="hand"/><origin xyz="0.4 0 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="4"/></joint></robot>"""


@pytest.fixture(scope="module")
def estimate() -> ident.Estimate:
    train, _ = ident.demo_logs()
    return ident.fit(train, "puma560", held=0)


def figures(result: object) -> dict[str, Figure]:
    return {f.name: f for f in report_of(result).figures}


def test_a_fit_shows_correlation_residual_spectrum_and_links(estimate):
    shown = figures(estimate)
    assert {"parameters", "correlation", "torque", "residual_axes", "spectrum", "robot"} <= set(shown)
    (panel,) = shown["correlation"].panels
    (cells,) = panel.layers
    assert cells.kind == BlockKind.CELLS
    std = np.sqrt(np.diag(estimate.covariance))
    own = np.array(cells.upper, float).reshape(len(std), len(std))
    assert own == pytest.approx(estimate.covariance / np.outer(std, std), abs=1e-4)
    assert panel.names == tuple(estimate.names)


def test_the_residual_stands_over_its_own_motion(estimate):
    signals, shown = estimate.problem.signals, figures(estimate)["residual_axes"]
    assert len(shown.panels) == 3 * 6
    cloud = shown.panels[3 * 2 + 1].layers[0]  # joint 3 against its speed
    used = np.isfinite(estimate.residual(signals)[:, 2])
    assert len(cloud.x) == used.sum()
    assert np.array(cloud.x) == pytest.approx(signals.dq[signals.centres, 2][used], rel=1e-4, abs=1e-9)
    assert np.std(np.array(cloud.y)) == pytest.approx(np.std(estimate.residual(signals)[used, 2]), rel=1e-3)


def test_a_sine_in_the_residual_is_a_peak_of_its_height(estimate):
    from ident.estimate.pictures import spectrum_figure

    signals = estimate.problem.signals
    residual = np.zeros_like(signals.tau)
    residual[:, 1] = 0.3 * np.sin(2 * np.pi * 1.7 * signals.row_time)
    line = spectrum_figure(estimate.model.robot, signals, residual).panels[1].layers[0]
    top = int(np.argmax(line.y))
    assert line.x[top] == pytest.approx(1.7, abs=2 / 40)
    assert line.y[top] == pytest.approx(0.3, rel=0.15)


def test_links_stand_where_pinocchio_puts_them():
    robot = ident.Robot.from_urdf(ARM)
    model = pin.buildModelFromXML(ARM)
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    places, frames = joint_frames(robot.tree)
    assert places == pytest.approx(np.array([data.oMi[i].translation for i in (1, 2)]))
    assert frames == pytest.approx(np.array([data.oMi[i].rotation for i in (1, 2)]))
    inertial = np.concatenate([model.inertias[i].toDynamicParameters() for i in (1, 2)])
    for panel, at in zip(robot_figure(robot, inertial).panels, ([0, 2], [0, 1]), strict=True):
        centres = next(layer for layer in panel.layers if layer.label == "centre of mass")
        wanted = np.array([data.oMi[i].act(model.inertias[i].lever) for i in (1, 2)])[:, at]
        assert np.column_stack([centres.x, centres.y]) == pytest.approx(wanted, abs=1e-4)
        # The outline of an ellipsoid of even density reaches √5 standard deviations of its mass along each axis.
        outline = next(layer for layer in panel.layers if layer.label == "body of even density")
        ring = np.array([(x, y) for x, y in zip(outline.x, outline.y, strict=True) if x is not None])[:49]
        inertia = data.oMi[1].rotation @ model.inertias[1].inertia @ data.oMi[1].rotation.T
        moments = (0.5 * np.trace(inertia) * np.eye(3) - inertia) / 2.0
        assert ring[:, 0].max() - wanted[0, 0] == pytest.approx(np.sqrt(5 * moments[at[0], at[0]]), rel=1e-2)


def test_a_link_of_no_size_of_the_robot_is_named_not_drawn():
    robot = ident.Robot.from_urdf(ARM)
    huge = np.array([1e-3, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 1.0])
    small = np.array([0.5, 0.05, 0, 0, 1e-3, 0, 2e-3, 0, 0, 2e-3])
    figure = robot_figure(robot, np.concatenate([huge, small]))
    assert "rod" in figure.caption
    assert len(next(layer for layer in figure.panels[0].layers if layer.label == "centre of mass").x) == 1


def test_every_result_has_a_full_report_with_its_answer_first(estimate, tmp_path):
    robot, (_, test) = ident.load_robot("puma560"), ident.demo_logs()
    held = ident.ZeroPhase()(test, robot)
    validation = ident.validate(estimate, held)
    assert {"torque", "residual_axes", "spectrum", "correlation"} <= set(figures(validation))
    assert f"{100 * validation.error.relative_all:.2f} %" in report_of(validation).headline
    judged = ident.judge(estimate)
    assert report_of(judged).headline == "Physically possible and consistent"
    assert report_of(judged).kind == "ok"
    from ident.signals.likewise import like

    found = ident.monitor(estimate, like(estimate.signals_config)(test, robot))
    assert {"residual_over_time", "torque", "residual_axes", "spectrum"} <= set(figures(found))
    motion = ident.excite(ident.Robot.from_urdf(ARM).rigid_body(), starts=1, iterations=1)
    path = figures(motion)["path"].panels[0].layers[0]
    assert path.x[0] == pytest.approx(path.x[-1], abs=1e-6), "the motion ends where it starts"
    (tmp_path / "r.json").write_text(report_of(estimate).to_json())
    assert read_report(tmp_path / "r.json") == report_of(estimate)


def test_a_judgement_that_is_bad_is_not_green(estimate):
    from dataclasses import replace

    judged = ident.judge(estimate)
    bad = replace(judged, possible=replace(judged.possible, possible=False))
    assert report_of(bad).kind == "unexplained"
    assert "Not physically possible" in report_of(bad).headline


def test_long_tables_can_be_searched_and_dark_pages_are_dark(estimate):
    pytest.importorskip("matplotlib")
    page = to_html(report_of(estimate))
    tables = [s for s in report_of(estimate).sections if isinstance(s, Table)]
    assert page.count('class="find"') == sum(len(t.rows) > 12 for t in tables) == 1
    assert "prefers-color-scheme: dark" in page
    assert re.search(r"@media \(max-width: \d+px\)", page)
    assert "http" not in re.sub(r"data:image/svg\+xml;base64,[\w+/=]+", "", page), "a report needs no network"
