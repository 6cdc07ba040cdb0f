"""Inputs that once went wrong: each folder of `../shared/cases` has a test of its kind; where the folder is, its commands are right."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FAULTS = "unit/test_known_faults.py"
FOLDER = Path(os.environ.get("IDENT_CASES", ROOT.parent / "shared" / "cases"))


@dataclass(frozen=True)
class Kind:
    """`test`: that of its kind. `says`, `not_said`: what must, and must not, stand in what the folder's commands print."""

    test: str
    says: tuple[str, ...] = ()
    not_said: tuple[str, ...] = ()


NEEDED = f"{FAULTS}::test_what_no_fit_needs_stops_nothing"
MISREAD = f"{FAULTS}::test_what_would_be_misread_is_refused"
KINDS = {
    "02-limits-of-the-largest-double": Kind(NEEDED, ("ok    mx_j2", "ok    Izz_j3")),
    "05-header-behind-a-hash": Kind(f"{FAULTS}::test_a_header_behind_a_sign_of_comment", (r"mx_j2 +1\.4 ",)),
    "08-robot-without-a-name": Kind(NEEDED, ("15 base parameters of 30",)),
    "09-negative-friction-in-dynamics": Kind(NEEDED, ("ok    mx_j2", "ok    Izz_j3")),
    "10-prefix-that-is-not-declared": Kind(NEEDED, ("15 base parameters of 30",)),
    "11-degrees-wrapped-to-0-360": Kind(f"{FAULTS}::test_angles_wrapped_to_a_full_turn_come_back_into_the_limits", ("ok    mx_j2",)),
    "12-unused-columns-of-one-name": Kind(f"{FAULTS}::test_unused_columns_of_one_name_stop_nothing_and_used_ones_do", (r"mx_j2 +1\.4 ",)),
    "13-macro-left-in-a-visual": Kind(NEEDED, ("15 base parameters of 30",)),
    "14-triangle-inequality": Kind(
        f"{FAULTS}::test_moments_that_no_mass_has_are_said", ("no body has these inertials of the URDF: link 'l2'",)
    ),
    "d01-concave-friction-dropped": Kind(
        "unit/test_diagnosis_rule.py::test_of_concave_friction_the_power_that_resists_is_kept",
        ("verdict: explained", r"\d\. nonlinear_viscous on j1", r"\d\. load_dependent_friction on j2"),
        ("withdrawn", "torque_nonlinearity"),
    ),
    "d02-mapped-columns-beside-others": Kind(
        f"{FAULTS}::test_columns_beyond_the_mapped_joints_are_others", ("exit 0", "q2_rad.* not used")
    ),
    "d03-cutoff-leaves-no-rows": Kind(
        f"{FAULTS}::test_rows_that_a_recorder_took_again_are_left_out",
        (r"(?s)wls: 62 parameters.*wls: 62 parameters.*wls: 62 parameters", "14 rows repeat the row before"),
        (r"\de1[0-9]",),
    ),
    "d04-abort-after-acceptance": Kind(f"{FAULTS}::test_a_fit_through_every_row_is_refused", ("exit 0",), ("ident diagnose: only",)),
    "r03-urdf-latin1-names": Kind(
        f"{FAULTS}::test_a_name_survives_its_encoding", ("fit exit 0", "validate exit 0", "export exit 0"), ("ï¿½",)
    ),
    "r04-export-entities-assert": Kind(MISREAD, ("fit exit 2", "document type")),
    "r07-urdf-mass-two-words-traceback": Kind(MISREAD, ("exit 2", "link 'lb'")),
    "r09-long-field-traceback": Kind(
        f"{FAULTS}::test_a_field_beyond_all_bounds_is_told_with_its_file_and_line", ("long exit 3", "longh exit 3", r"long\.csv: line 6")
    ),
    "r10-many-columns-quadratic": Kind(f"{FAULTS}::test_very_many_columns_take_no_longer_for_each", ("exit 3",)),
    "r15-full-disk-read-only-traceback": Kind(
        f"{FAULTS}::test_a_full_disk_and_a_place_that_takes_nothing_are_said_in_one_line",
        ("folder exit 2", "long name exit 2", "long log name exit 2"),
        ("disk exit [^2]", "read-only exit [^2]"),
    ),
    "r16-toml-key-of-dots-memory": Kind(
        f"{FAULTS}::test_a_study_that_is_none_is_refused_quickly", ("\nexit 2", "deep exit 2", "digits exit 2")
    ),
    "r18-gz-bomb-memory": Kind(f"{FAULTS}::test_a_line_without_an_end_is_no_table", ("exit 3", "line of more than")),
    "r19-axis-without-xyz": Kind(f"{FAULTS}::test_an_axis_without_numbers_is_that_of_urdf", ("base exit 0", "agree: "), ("DO NOT AGREE",)),
    "r20-mimic-offset-inf": Kind(MISREAD, ("exit 2", "offset='inf'")),
}


def test_no_folder_of_cases_is_without_a_test() -> None:
    if not FOLDER.is_dir():
        pytest.skip(f"the cases are not here ({FOLDER}); set IDENT_CASES to their folder")
    assert {p.name for p in FOLDER.iterdir() if p.is_dir()} - {"_common"} == set(KINDS)


@pytest.mark.parametrize("test", sorted({kind.test for kind in KINDS.values()}))
def test_the_tests_of_the_kinds_are_there(test: str) -> None:
    file, name = test.split("::")
    assert f"def {name}(" in (ROOT / "tests" / file).read_text()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*KINDS])
def test_the_commands_of_a_case_are_right(name: str, tmp_path: Path) -> None:
    if not FOLDER.is_dir():
        pytest.skip(f"the cases are not here ({FOLDER}); set IDENT_CASES to their folder")
    for part in (name, "_common"):
        shutil.copytree(FOLDER / part, tmp_path / part, copy_function=shutil.copyfile)
    for folder in (tmp_path / name, tmp_path / "_common"):
        folder.chmod(0o755)
    programs = tmp_path / "bin"
    programs.mkdir()
    for program, options in (("ident", "-m ident.cli"), ("python", ""), ("python3", "")):
        (programs / program).write_text(f'#!/bin/sh\nexec "{sys.executable}" {options} "$@"\n')
        (programs / program).chmod(0o755)
    around = {"PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "IDENT": "ident", "PY": "python"}
    done = subprocess.run(
        ["bash", str(tmp_path / name / "run.sh")], check=False, capture_output=True, text=True, env={**os.environ, **around}
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    for pattern in KINDS[name].says:
        assert re.search(pattern, said), f"{pattern!r} is not in:\n{said}"
    for pattern in (*KINDS[name].not_said, "Traceback", "WRONG"):
        assert not re.search(pattern, said), f"{pattern!r} is in:\n{said}"
