"""`ident plan`, `ident simulate --plan` and `ident fit --plan` from end to end, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ident.cli import main

EFFECTS = ("--effects", "viscous", "coulomb")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `plan` (manifest) and `logs` (its tests, tracked exactly, little noise) of the SCARA."""
    folder = tmp_path_factory.mktemp("planned")
    assert main(["plan", "--robot", "scara", "--out", str(folder / "plan"), "--motion", "100", "--quiet"]) == 0
    exact = ["--tracking", "exact", "--counts", "0", "--noise", "0.001", "--quiet"]
    assert main(["simulate", "--plan", str(folder / "plan" / "plan.toml"), "--out", str(folder / "logs"), *exact]) == 0
    return folder


def test_the_plan_is_written_for_people_and_programs(planned: Path) -> None:
    data = json.loads((planned / "plan" / "plan.json").read_text(encoding="utf-8"))
    assert data["schema"] == "ident.plan/1"
    assert data["rank"] == len(data["base"])
    text = (planned / "plan" / "plan.txt").read_text(encoding="utf-8")
    for test in data["tests"]:
        assert test["name"] in text
        assert test["log"] in text
        assert (planned / "plan" / ("motion_" + test["log"].removesuffix(".gz"))).is_file()
        assert (planned / "logs" / test["log"]).is_file()


def test_the_plan_is_the_safe_one_unless_another_is_named(ident) -> None:
    counts = {}
    for flags in ((), ("--separation", "coupled"), ("--published", "yoshida1995")):
        ran = ident("plan", "--robot", "puma560", *flags, "--postures", "2", "--json", "--quiet")
        assert ran.code == 0, ran.err
        counts[flags] = [t["name"] for t in ran.json["tests"] if t["kind"] == "accelerated"]
    assert [len(tests) for tests in counts.values()] == [15, 13, 13]
    assert set(counts["--published", "yoshida1995"]) == set(counts["--separation", "coupled"])
    other = ident("plan", "--robot", "scara", "--published", "yoshida1995")
    assert (other.code, "published plan" in other.err) == (2, True)


def test_fit_reads_the_logs_through_the_manifest(ident, planned: Path) -> None:
    ran = ident("fit", "--robot", "scara", "--plan", planned / "logs" / "plan.toml", "--json", "--quiet")
    assert ran.code == 0, ran.err
    assert ran.json["method"] == "sequential"
    truth = json.loads((planned / "logs" / "simulation.json").read_text(encoding="utf-8"))["parameters"]
    assert ran.json["trace"]["steps"][0]["test"] in ran.err
    for p in ran.json["parameters"]:
        if p["name"].startswith(("Fv", "Fc")):
            assert p["value"] == pytest.approx(truth[p["name"]], abs=5 * p["std"] + 0.01 * abs(truth[p["name"]])), p["name"]


def test_a_study_names_the_plan_from_its_own_folder(ident, planned: Path) -> None:
    study = planned / "study.toml"
    study.write_text('[robot]\nname = "scara"\n[estimator]\nmethod = "sequential"\nplan = "logs/plan.toml"\n', encoding="utf-8")
    ran = ident("fit", study, "--json", "--quiet")
    assert ran.code == 0, ran.err
    assert np.isfinite([p["value"] for p in ran.json["parameters"]]).all()
    assert any("needs whole logs" in w for w in ran.json["warnings"])


def test_seeds_give_other_noise(planned: Path, tmp_path: Path) -> None:
    test = json.loads((planned / "plan" / "plan.json").read_text(encoding="utf-8"))["tests"][0]
    texts = []
    for seed in ("1", "1", "2"):
        out = tmp_path / f"{len(texts)}"
        one = ["--tests", test["name"], "--tracking", "exact", "--seed", seed, "--quiet"]
        assert main(["simulate", "--plan", str(planned / "plan" / "plan.toml"), "--out", str(out), *one]) == 0
        texts.append((out / test["log"]).read_bytes())
    assert texts[0] == texts[1] != texts[2]


def test_refusals(ident, planned: Path, tmp_path: Path) -> None:
    manifest = planned / "logs" / "plan.toml"
    again = ident("plan", "--robot", "scara", "--out", planned / "plan")
    assert (again.code, "not empty" in again.err) == (2, True)
    over = ident("simulate", "--plan", manifest, "--out", planned / "logs")
    assert (over.code, "not empty" in over.err) == (2, True)
    other = ident("fit", "--robot", "puma560", "--plan", manifest)
    assert (other.code, "is for joints" in other.err) == (2, True)
    unlike = ident("simulate", "--robot", "puma560", "--plan", manifest, "--out", tmp_path / "a")
    assert (unlike.code, "is for joints" in unlike.err) == (2, True)
    absent = ident("fit", "--robot", "scara", "--plan", planned / "plan" / "plan.toml")
    assert (absent.code, "static" in absent.err or "accelerated" in absent.err) == (3, True)
    broken = tmp_path / "broken.toml"
    broken.write_text("[plan", encoding="utf-8")
    for command in (("fit", "--robot", "scara", "--plan", broken), ("simulate", "--plan", broken, "--out", tmp_path / "b")):
        ran = ident(*command)
        assert (ran.code, "broken.toml" in ran.err) == (2, True)
    method = ident("fit", "--robot", "scara", "--method", "wls", "--plan", manifest)
    assert (method.code, "sequential" in method.err) == (2, True)
    named = ident("simulate", "--plan", manifest, "--log", "x.csv", "--out", tmp_path / "c")
    assert (named.code, "--log" in named.err, (tmp_path / "c").exists()) == (2, True, False)
    loose = ident("simulate", "--robot", "scara", "--tests", "x")
    assert (loose.code, "--plan" in loose.err) == (2, True)
