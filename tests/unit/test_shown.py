"""Results show themselves: as pictures on axes, as pandas tables, in a notebook; and tables in memory are read as logs."""

from __future__ import annotations

import re
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident
from ident.drawing import figures
from ident.drawing.figures import COLOURS
from ident.errors import ConfigurationError, DataError
from ident.estimate.significance import insignificant

mpl = pytest.importorskip("matplotlib")
mpl.use("Agg")


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    robot = ident.load_robot("puma560")
    train, test = ident.demo_logs()
    estimate = ident.fit(train, robot, held=test)
    plain = ident.fit(train, robot, model=ident.friction.Viscous(), held=0)
    held = ident.ZeroPhase()(test, robot)
    return {
        "log": train[0],
        "signals": held,
        "audit": ident.audit(train, robot),
        "estimate": estimate,
        "validation": ident.validate(estimate, held),
        "comparison": ident.compare(plain, estimate, held),
        "diagnosis": ident.diagnose(estimate, held),
        "judgement": ident.judge(estimate),
        "excitation": ident.excite(ident.load_robot("scara").rigid_body(), starts=1, iterations=2),
    }


DRAWN = ("log", "signals", "estimate", "validation", "comparison", "diagnosis", "judgement", "excitation")


@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_on_new_axes_on_given_ones_and_within_one(results: dict[str, Any], name: str) -> None:
    import matplotlib.pyplot as plt

    result = results[name]
    axes = np.atleast_1d(result.plot())
    assert len(axes) == len(result.figure().panels)
    assert all(ax.lines or ax.collections for ax in axes)
    _, one = plt.subplots()
    within = np.atleast_1d(result.plot(ax=one))
    assert all(ax.figure is one.figure for ax in within)
    _, many = plt.subplots(len(axes))
    assert list(np.atleast_1d(result.plot(ax=many))) == list(np.atleast_1d(many))
    with pytest.raises(ConfigurationError, match="axes were given"):
        result.plot(ax=[*np.atleast_1d(many), one])
    plt.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_colours_that_everyone_tells_apart(results: dict[str, Any], name: str) -> None:
    """Only those of Okabe and Ito, and greys; labels in words, so that nothing hangs on colour alone."""
    known = {mpl.colors.to_hex(c) for c in COLOURS.values()}
    for ax in np.atleast_1d(results[name].plot()):
        assert {mpl.colors.to_hex(line.get_color()) for line in ax.lines} <= known
    mpl.pyplot.close("all")


def test_without_matplotlib_it_is_said_what_to_install(results: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(figures.importlib, "import_module", absent)
    with pytest.raises(ConfigurationError, match=r"ident\[report\]"):
        results["estimate"].plot()


@pytest.mark.parametrize("name", [*DRAWN, "audit"])
def test_a_notebook_shows_words_and_tables(results: dict[str, Any], name: str) -> None:
    page = results[name]._repr_html_()
    assert re.search("<(section|pre)", page)
    assert page.count("<table>") == page.count("</table>")
    assert "<style" not in page, "a notebook keeps its own style, dark or light"


def test_the_picture_of_torque_is_that_of_the_data(results: dict[str, Any]) -> None:
    estimate, signals = results["estimate"], results["signals"]
    torque, residual = estimate.plot_torque(signals)[4:6]
    used = signals.valid[:, 2] & np.isfinite(estimate.residual(signals)[:, 2])
    shown = {line.get_label(): line.get_ydata() for line in torque.lines}
    np.testing.assert_allclose(shown["measured"][np.isfinite(shown["measured"])], signals.tau[used, 2], rtol=1e-4)
    np.testing.assert_allclose(shown["predicted"][np.isfinite(shown["predicted"])], estimate.predict(signals)[used, 2], rtol=1e-4)
    drawn = residual.lines[0].get_ydata()
    np.testing.assert_allclose(drawn[np.isfinite(drawn)], (signals.tau - estimate.predict(signals))[used, 2], rtol=1e-3, atol=1e-6)
    with pytest.raises(ConfigurationError, match="plot_torque"):
        replace(estimate, problem=None).plot_torque()
    mpl.pyplot.close("all")


def test_tables_hold_the_numbers(results: dict[str, Any]) -> None:
    estimate = results["estimate"]
    table = estimate.to_frame()
    assert table.loc["Fc_joint1", "value"] == estimate.value("Fc_joint1")
    half = 1.959964 * table["std"]
    np.testing.assert_allclose(table["high"] - table["value"], half, rtol=1e-6)
    errors = results["validation"].to_frame()
    assert errors.loc["all joints", "held out: relative"] == results["validation"].error.relative_all
    assert results["comparison"].to_frame().loc["joint2", "before: rms"] == results["comparison"].error_before.rms[1]
    rows = results["signals"].to_frame()
    assert rows["joint3.used"].sum() == results["signals"].valid[:, 2].sum()
    assert list(results["judgement"].to_frame().index) == [f"link{i}" for i in range(1, 7)]
    assert results["diagnosis"].to_frame().empty
    assert len(results["audit"].to_frame()) == len(results["audit"].findings)
    motion = results["excitation"].to_frame()
    np.testing.assert_allclose(np.gradient(motion["q1"], motion["t"])[5:-5], motion["dq1"][5:-5], atol=1e-3)


def test_insignificant_is_told_by_interval_and_share(results: dict[str, Any]) -> None:
    """Against the definition, worked out by hand: |value| < 1.96 std, or std > 0.3 |value|."""
    estimate = results["estimate"]
    values, std = np.array(estimate.values), np.array(estimate.std)
    values[3], values[5], values[7] = 0.0, 2.5 * std[5], 4.0 * std[7]
    found = {i.name: i for i in insignificant(replace(estimate, values=values))}
    assert found[estimate.names[3]].covers_zero
    assert not found[estimate.names[5]].covers_zero
    assert estimate.names[7] not in found
    text = replace(estimate, values=values).summary()
    assert "95 % interval covers zero" in text
    assert f"std above 30 %: {estimate.names[5]}" in text
    assert "record motion" in " ".join(text.split())


def test_a_log_from_a_table_and_back() -> None:
    robot = ident.load_robot("puma560")
    train, _ = ident.demo_logs()
    table = train[0].to_frame()
    for back in (ident.read_logs(table, robot)[0], ident.read_logs([table], robot)[0]):
        np.testing.assert_array_equal(back.t, train[0].t)
        np.testing.assert_array_equal(back.q, train[0].q)
        np.testing.assert_array_equal(back.tau["motor"], train[0].tau["motor"])
        assert not back.source
    assert ident.fit(table, robot, held=0).value("Fc_joint1") == ident.fit(train, robot, held=0).value("Fc_joint1")


def test_times_as_an_index_and_names_as_in_a_file() -> None:
    pd = pytest.importorskip("pandas")
    t = np.arange(50) * 0.01
    table = pd.DataFrame({"q1_deg": np.rad2deg(np.sin(t)), "tau1": np.cos(t)}, index=pd.to_timedelta(t, unit="s"))
    log = ident.read_logs(table)[0]
    np.testing.assert_allclose(log.t, t, atol=1e-9)
    np.testing.assert_allclose(log.q[:, 0], np.sin(t), atol=1e-12)
    mapping = {"t": "t", "q1_deg": "angle", "tau1": "tau1"}
    (mapped,) = ident.read_logs(table.rename(columns={"q1_deg": "angle"}), columns=mapping)
    np.testing.assert_allclose(mapped.q[:, 0], np.sin(t), atol=1e-12)


def test_tables_that_cannot_be_used_are_refused() -> None:
    pd = pytest.importorskip("pandas")
    t = np.arange(50) * 0.01
    twice = pd.DataFrame(np.column_stack([t, t, t]), columns=["t", "q1", "q1"])
    with pytest.raises(DataError, match="q1' occurs 2 times"):
        ident.read_logs(twice)
    words = pd.DataFrame({"t": t, "q1": ["a"] * 50, "tau1": t})
    with pytest.raises(DataError, match=r"DataFrame: column 'q1'.*not a number"):
        ident.read_logs(words)
    with pytest.raises(DataError):
        ident.read_logs(pd.DataFrame({"t": [], "q1": [], "tau1": []}))


def test_a_log_is_made_of_a_table() -> None:
    train, _ = ident.demo_logs()
    table = train[0].to_frame()
    (made,) = ident.read_logs(
        table.rename(columns={"q1": "a"}), ident.load_robot("puma560"), columns={**{c: c for c in table.columns if c != "q1"}, "q1": "a"}
    )
    np.testing.assert_array_equal(made.q, train[0].q)
    with pytest.raises(DataError):
        ident.read_logs(table.head(1))


@pytest.mark.parametrize("name", ["validation", "comparison", "judgement", "excitation", "audit", "estimate"])
def test_every_result_has_a_report(results: dict[str, Any], name: str, tmp_path: Path) -> None:
    page = ident.report(results[name], tmp_path / "r.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert ("<img" in page) == (name != "audit")
    for section in results[name].sections():
        assert escape(section.title) in page


def test_logs_one_below_the_other() -> None:
    train, test = ident.demo_logs()
    both = ident.LogSet((*train, *test)).to_frame()
    assert len(both) == len(train[0]) + len(test[0])
    assert list(dict.fromkeys(both["run"])) == [*train.names, *test.names]
