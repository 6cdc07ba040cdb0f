"""`ident diagnose` and `ident report`: result, artefacts, gates, and a study that is ready for the next log."""

from __future__ import annotations

import json
from html.parser import HTMLParser

import numpy as np
import pytest
from command_line import FRICTION, JOINTS, analytic_log, write_csv

CONFIGURATION, DATA = 2, 3


@pytest.fixture(scope="module")
def lacking(arm, tmp_path_factory):
    """Two logs of the arm with viscous friction of the elbow that depends on direction, which the study beside them does not declare."""
    from ident import Robot, make_effect
    from ident import friction as fr

    folder = tmp_path_factory.mktemp("lacking")
    robot = Robot.from_urdf(arm.urdf)
    model = robot.rigid_body() + fr.Viscous() + fr.Coulomb() + make_effect("asymmetric_viscous", joints=["elbow"])
    values = np.concatenate([robot.nominal, [20.0, 1.0, 0.5, 0.1], [10.0, 2.0, 1.0, 0.2], [0.25]])
    for name, seed in (("train", 3), ("test", 4)):
        write_csv(folder / f"{name}.csv", analytic_log(model, values, seed, seconds=12.0, noise=5e-3))
    (folder / "arm.urdf").write_text(arm.urdf.read_text())
    (folder / "study.toml").write_text(
        '[robot]\nurdf = "arm.urdf"\n[drive]\neffects = ["viscous", "coulomb"]\n'
        '[logs]\nfit = ["train.csv"]\nvalidate = ["test.csv"]\n[signals]\ncutoff_hz = 10.0\n'
    )
    return folder


@pytest.fixture(scope="module")
def diagnosed(lacking, tmp_path_factory):
    """The command run once, its artefacts in a folder elsewhere: exit code, JSON, folder."""
    import contextlib
    import io

    from ident.cli import main

    out = tmp_path_factory.mktemp("elsewhere") / "deep" / "result"
    printed, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        code = main(["diagnose", str(lacking / "study.toml"), "--json", "--strict", "--quiet", "--out", str(out)])
    return code, json.loads(printed.getvalue()), said.getvalue(), out


def test_the_missing_effect_is_named(diagnosed):
    _, result, text, _ = diagnosed
    assert result["verdict"] != "clean"
    found = result["findings"][0]
    assert (found["effect"], found["joints"]) == ("asymmetric_viscous", ["elbow"])
    value, std = found["parameters"][0]["value"], found["parameters"][0]["std"]
    assert abs(value - 0.25) < 4 * std
    assert text.splitlines()[0].startswith("verdict:")


def test_json_is_as_designed(diagnosed):
    _, result, _, out = diagnosed
    assert result["schema"] == "ident.diagnosis/1"
    assert {"ident_version", "inputs", "created", "warnings", "verdict", "findings", "unexplained", "before", "after"} <= set(result)
    assert all({"path", "sha256"} <= set(i) for i in result["inputs"])
    keys = {"effect", "joints", "parameters", "heldout_gain", "confidence", "imitators", "advice"}
    for finding in result["findings"]:
        assert keys <= set(finding)
        assert 0 <= finding["confidence"] <= 1
        assert finding["advice"]
        assert all({"name", "value", "std", "unit"} <= set(p) for p in finding["parameters"])
        assert all({"effect", "joints", "confidence"} <= set(i) for i in finding["imitators"])
    for side in ("before", "after"):
        for data in ("fit", "heldout"):
            error = result[side][data]
            assert {"rms", "relative", "relative_all"} <= set(error)
            assert len(error["rms"]) == len(error["relative"]) == len(JOINTS)
    assert result["after"]["heldout"]["relative_all"] < 0.6 * result["before"]["heldout"]["relative_all"]
    kept = json.loads((out / "diagnosis.json").read_text())
    assert {k: v for k, v in kept.items() if k != "created"} == {k: v for k, v in result.items() if k != "created"}


def test_strict_fails_on_a_finding(diagnosed):
    assert diagnosed[0] == 1


def test_artefacts(diagnosed):
    out = diagnosed[3]
    names = {p.name for p in out.iterdir()}
    fits = {"before.fit.json", "after.fit.json"}
    assert names == {"diagnosis.json", "diagnosis.txt", *fits, "extended.toml", "report.html", "report.json", "figures"}
    assert [p.name for p in out.parent.iterdir()] == ["result"], "nothing temporary is left beside the folder"


def test_extended_study_fits_the_next_log(ident, diagnosed):
    out = diagnosed[3]
    assert "train.csv" in (out / "extended.toml").read_text()
    ran = ident("fit", out / "extended.toml", "--quiet", "--json")
    assert ran.code == 0
    fitted = {p["name"]: p for p in ran.json["parameters"]}
    assert fitted["dFv_elbow"]["value"] == pytest.approx(0.25, abs=5 * fitted["dFv_elbow"]["std"])


def test_after_fit_predicts_better(ident, lacking, diagnosed):
    ran = ident("validate", "--fit", diagnosed[3] / "after.fit.json", "--validate", lacking / "test.csv", "--no-replay", "--json")
    assert ran.json["torque_error"]["heldout"]["relative_all"] == pytest.approx(diagnosed[1]["after"]["heldout"]["relative_all"], rel=1e-6)


def test_compare_before_and_after(ident, lacking, diagnosed, tmp_path):
    before, after = (diagnosed[3] / f"{side}.fit.json" for side in ("before", "after"))
    ran = ident("compare", before, after, "--log", lacking / "test.csv", "--json", "--strict", "--out", tmp_path / "out")
    assert ran.code == 0
    found = ran.json
    assert found["schema"] == "ident.comparison/1"
    assert [len(i["sha256"]) for i in found["inputs"]] == [64]
    for side in ("before", "after"):
        kept = diagnosed[1][side]["heldout"]
        assert found[side]["heldout"]["relative_all"] == pytest.approx(kept["relative_all"], rel=1e-6)
        assert found[side]["heldout"]["rms"] == pytest.approx(kept["rms"], rel=1e-6)
    assert found["gain"] > 10 * found["gain_std"] > 0
    assert {s["name"] for s in found["shifts"]} >= {"Fv_elbow", "Fc_elbow"}
    assert json.loads((tmp_path / "out" / "comparison.json").read_text())["gain"] == found["gain"]
    # The other way round, the later fit is the worse one: the gate says so.
    assert ident("compare", after, before, "--log", lacking / "test.csv", "--strict").code == 1


def test_compare_refusals(ident, lacking, diagnosed, saved_fit):
    after = diagnosed[3] / "after.fit.json"
    assert ident("compare", after, after).code == CONFIGURATION
    assert ident("compare", after, lacking / "test.csv", "--log", lacking / "test.csv").code == CONFIGURATION
    assert ident("compare", after, saved_fit, "--log", lacking / "none.csv").code == DATA


class _Checked(HTMLParser):
    """Every element is closed in turn, and nothing is fetched from elsewhere."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.images = 0

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        assert tag not in ("link", "iframe")
        assert tag != "script" or not found, "a script of the page's own, from nowhere else"
        if tag == "img":
            self.images += 1
            assert found["src"].startswith("data:image/svg+xml;base64,")
            assert found["alt"]
        assert not any(str(v).startswith(("http:", "https:", "//")) for v in found.values())
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)


def test_report_is_one_sound_file(diagnosed):
    _, result, _, out = diagnosed
    page = _Checked()
    text = (out / "report.html").read_text()
    page.feed(text)
    assert page.open == []
    assert page.images == len(list((out / "figures").glob("*.svg"))) >= 2
    assert "@media print" in text
    said = " ".join(page.text)
    first = next(line for line in page.text if line.strip())
    assert first.lower().startswith(result["verdict"])
    assert "asymmetric_viscous" in said
    assert "±" in said
    for heading in (
        "Torque error before and after",
        "Residual over time",
        "Advice",
        "How the other parameters moved",
        "Replayed motion",
        "Data",
    ):
        assert heading in said, heading


def test_report_again_from_what_was_kept(ident, diagnosed, tmp_path):
    out = diagnosed[3]
    target = tmp_path / "again.html"
    assert ident("report", out / "diagnosis.json", "-o", target, "--figures", tmp_path / "figures").code == 0
    assert target.read_text() == (out / "report.html").read_text()
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {p.name for p in (out / "figures").iterdir()}
    ran = ident("report", out, "-o", target)
    assert ran.code == CONFIGURATION
    assert "--force" in ran.err


def test_report_of_a_fit(ident, saved_fit, tmp_path):
    assert ident("report", saved_fit, "-o", tmp_path / "fit.html").code == 0
    assert "Fv_shoulder" in (tmp_path / "fit.html").read_text()


@pytest.mark.parametrize(
    ("content", "message"), [(None, "no such file"), ("{}", "there is no report of this"), ("not json", "is not JSON")]
)
def test_report_refusals(ident, tmp_path, content, message):
    path = tmp_path / "some.json"
    if content is not None:
        path.write_text(content)
    ran = ident("report", path, "-o", tmp_path / "r.html")
    assert ran.code == CONFIGURATION
    assert message in ran.err
    assert not (tmp_path / "r.html").exists()


def test_report_without_matplotlib(ident, diagnosed, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib", None)
    ran = ident("report", diagnosed[3], "-o", tmp_path / "r.html")
    assert ran.code == CONFIGURATION
    assert "ident[report]" in ran.err


def test_nothing_is_overwritten(ident, lacking, diagnosed):
    out = diagnosed[3]
    before = {p: p.stat().st_mtime_ns for p in out.iterdir()}
    ran = ident("diagnose", lacking / "study.toml", "--quiet", "--out", out)
    assert ran.code == CONFIGURATION
    assert "--force" in ran.err
    assert {p: p.stat().st_mtime_ns for p in out.iterdir()} == before


def test_a_failed_command_leaves_no_folder(ident, lacking, tmp_path):
    ran = ident("diagnose", lacking / "study.toml", "--log", lacking / "none.csv", "--quiet", "--out", tmp_path / "a" / "out")
    assert ran.code == DATA
    assert not (tmp_path / "a").exists()
    assert ident("diagnose", lacking / "missing.toml", "--out", tmp_path / "out").code == CONFIGURATION
    assert not (tmp_path / "out").exists()


def test_artefacts_appear_together_or_not_at_all(tmp_path):
    from ident._utils.files import staged
    from ident.errors import ConfigurationError

    folder = tmp_path / "out"

    def write(texts, force=False):
        with staged(folder, force=force) as scratch:
            for name, text in texts.items():
                (scratch / name).parent.mkdir(exist_ok=True)
                (scratch / name).write_text(text)
            if "fails" in texts:
                raise RuntimeError

    with pytest.raises(RuntimeError):
        write({"one.txt": "1", "fails": ""})
    assert list(tmp_path.iterdir()) == []
    write({"one.txt": "1", "sub/two.txt": "2"})
    assert (folder / "sub" / "two.txt").read_text() == "2"
    with pytest.raises(ConfigurationError, match="nothing was written"):
        write({"new.txt": "3", "one.txt": "4"})
    assert not (folder / "new.txt").exists()
    assert (folder / "one.txt").read_text() == "1"
    write({"one.txt": "5"}, force=True)
    assert (folder / "one.txt").read_text() == "5"


def test_flags_do_what_a_study_does(ident, arm, tmp_path):
    """A log without anything undeclared in it: clean, exit code 0 even under --strict."""
    ran = ident("diagnose", "--urdf", arm.urdf, "--log", arm.train, "--validate", arm.test, *FRICTION, "--strict", "--json", "--quiet")
    assert ran.json["verdict"] == "clean"
    assert ran.json["findings"] == []
    assert ran.code == 0


def test_check_strict_finds_what_is_not_declared(ident, lacking, tmp_path):
    """The gate of DESIGN.md 3.3: exit code 1 for an undeclared effect, which plain `check` does not look for."""
    flags = ("check", lacking / "study.toml", "--json", "--quiet")
    plain = ident(*flags)
    assert plain.code == 0
    assert "diagnosis" not in plain.json
    ran = ident(*flags, "--strict", "--out", tmp_path / "out")
    assert ran.code == 1
    found = ran.json["diagnosis"]
    assert found["verdict"] != "clean"
    assert (found["findings"][0]["effect"], found["findings"][0]["joints"]) == ("asymmetric_viscous", ["elbow"])
    assert "gate: " in ran.err
    assert json.loads((tmp_path / "out" / "check.json").read_text())["diagnosis"] == found
    ran = ident(*flags, "--strict", "--stream")
    assert ran.code == CONFIGURATION
    assert "--stream" in ran.err


def test_progress_moves_in_small_steps(lacking):
    import ident as toolkit
    from ident.study.session import Session
    from ident.study.study import read_study

    session = Session(read_study(lacking / "study.toml"))
    shares: list[float] = []
    toolkit.diagnose(session.estimate, session.held_signals, progress=shares.append)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    steps = np.diff(shares)
    assert np.all(steps >= 0.0)
    assert steps.max() <= 0.3


def _without_first_torque(lacking, folder):
    """The training log without the torque of its first joint."""
    header, *rows = (lacking / "train.csv").read_text().splitlines()
    gone = header.split(",").index("tau1")
    (folder / "part.csv").write_text("\n".join(",".join(np.delete(row.split(","), gone)) for row in (header, *rows)) + "\n")
    return folder / "part.csv"


@pytest.mark.parametrize("command", [("diagnose",), ("check", "--strict")])
def test_a_joint_without_torque_leaves_the_others_to_be_diagnosed(command, lacking, tmp_path, capsys):
    """The first joint has no torque; what the elbow lacks is found all the same."""
    from ident.cli import main

    log = _without_first_torque(lacking, tmp_path)
    code = main([*command, "--urdf", str(lacking / "arm.urdf"), "--log", str(log), "--effects", "viscous", "coulomb", "--quiet"])
    assert code == (1 if "--strict" in command else 0)
    assert "asymmetric_viscous on elbow" in capsys.readouterr().out


def test_torque_missing_on_every_motor_is_refused(lacking, tmp_path, capsys):
    """Every motor feels the first joint, whose torque is missing: no motor's torque is known."""
    from ident.cli import main

    K = 0.01 * np.eye(len(JOINTS))
    K[0] = 0.01
    _without_first_torque(lacking, tmp_path)
    (tmp_path / "study.toml").write_text(
        f'[robot]\nurdf = "{lacking / "arm.urdf"}"\n[drive]\nK = {K.tolist()}\nmeasured = "joint"\neffects = ["viscous", "coulomb"]\n'
        '[logs]\nfit = ["part.csv"]\n[signals]\ncutoff_hz = 10.0\n'
    )
    assert main(["diagnose", str(tmp_path / "study.toml"), "--quiet"]) == DATA
    assert "`ident check` says what is missing for which joint" in capsys.readouterr().err
