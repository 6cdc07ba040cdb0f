"""What the names of a log's columns say: numbers from 0, and which columns a mapping leaves alone."""

from __future__ import annotations

import pytest

from ident.errors import ConfigurationError, DataError
from ident.logs.column_plan import ColumnPlan
from ident.logs.columns import resolve_columns
from ident.logs.names import JointNames

ARM = JointNames(("shoulder", "slide", "elbow"), (False, True, False))
FROM_ZERO = ["t", "q0", "q1", "q2", "tau0", "tau1", "tau2"]
FROM_ONE = ["t", "q1", "q2", "q3", "tau1", "tau2", "tau3"]


def sources(plan: ColumnPlan) -> dict[str, list[str]]:
    return {q: [c.source for c in plan.quantity(q)] for q in ("q", "dq", "tau_joint", "tau_current") if plan.quantity(q)}


class TestLocked:
    """A robot of four joints, the second and the last of which are locked."""

    JOINTS = JointNames(("waist", "elbow"), (False, False), whole=("waist", "lift", "elbow", "wrist"))
    HEADER = ("t", *(f"{s}{j}" for s in ("q", "tau") for j in range(1, 5)))

    def test_columns_of_the_whole_robot(self) -> None:
        plan = resolve_columns(self.HEADER, self.JOINTS)
        assert sources(plan) == {"q": ["q1", "q3"], "tau_joint": ["tau1", "tau3"]}
        assert all(name in plan.notes[0] for name in ("lift", "wrist", "q2", "q4", "tau2", "tau4"))

    def test_columns_of_what_is_left(self) -> None:
        plan = resolve_columns(["t", "q1", "q2", "tau1", "tau2"], self.JOINTS)
        assert sources(plan) == {"q": ["q1", "q2"], "tau_joint": ["tau1", "tau2"]}
        assert plan.notes == ()

    def test_a_mapping_counts_as_the_columns_do(self) -> None:
        mapping = {"tau1": "a", "tau2": "b", "tau3": "c", "tau4": "d"}
        plan = resolve_columns(["t", "q1", "q2", "q3", "q4", "a", "b", "c", "d"], self.JOINTS, mapping)
        assert sources(plan) == {"q": ["q1", "q3"], "tau_joint": ["a", "c"]}

    def test_positions_by_name(self) -> None:
        header = ["t", "waist.position", "elbow.position", "lift.position", "tau1", "tau2", "tau3", "tau4"]
        assert sources(resolve_columns(header, self.JOINTS))["tau_joint"] == ["tau1", "tau3"]

    @pytest.mark.parametrize("count", [1, 3, 5])
    def test_any_other_number_is_refused_with_what_to_do(self, count: int) -> None:
        with pytest.raises(
            DataError, match=r"Locked: lift, wrist\. Number the columns by the 2 remaining joints .*waist, elbow.* or by all 4"
        ):
            resolve_columns(["t", *(f"q{j + 1}" for j in range(count))], self.JOINTS)

    def test_counted_from_zero(self) -> None:
        with pytest.raises(DataError, match="from 0"):
            resolve_columns(["t", "q0", "q1", "q2", "q3"], self.JOINTS)


class TestFromZero:
    @pytest.mark.parametrize("joints", [ARM, None])
    @pytest.mark.parametrize("header", [FROM_ZERO, ["t", "q0 [deg]", "q1 [deg]", "q2 [deg]"], ["t", "q0", "tau0"]])
    def test_joints_counted_from_zero_are_never_shifted(self, header: list[str], joints: JointNames | None) -> None:
        with pytest.raises(DataError, match=r"joints are counted from 1\. Map .*under \[columns\] of a study file: q1 = \"q0"):
            resolve_columns(header, joints)

    def test_the_message_says_how_to_map(self) -> None:
        with pytest.raises(DataError, match=r"'q0', 'q1', 'q2' seem .*: q1 = \"q0\", q2 = \"q1\", q3 = \"q2\"\.$"):
            resolve_columns(FROM_ZERO, ARM)

    def test_a_mapping_is_used(self) -> None:
        mapping = {f"{s}{j + 1}": f"{s}{j}" for s in ("q", "tau") for j in range(3)}
        found = sources(resolve_columns(FROM_ZERO, ARM, mapping))
        assert found == {"q": ["q0", "q1", "q2"], "tau_joint": ["tau0", "tau1", "tau2"]}
        positions = resolve_columns(FROM_ZERO, ARM, {k: v for k, v in mapping.items() if k.startswith("q")})
        assert sources(positions) == {"q": ["q0", "q1", "q2"]}, "torque that is not mapped is not shifted"

    @pytest.mark.parametrize("column", ["i0", "q0", "tau0", "dq_m0", "q0 [deg]"])
    def test_a_column_more_is_left_unused(self, column: str) -> None:
        plan = resolve_columns([*FROM_ONE, column], ARM)
        assert sources(plan) == {"q": ["q1", "q2", "q3"], "tau_joint": ["tau1", "tau2", "tau3"]}
        assert plan.extra == (column,)
        assert plan.notes == (f"log: column {column!r} is not used: joints are counted from 1.",)

    @pytest.mark.parametrize("header", [["t", "q1", "q2", "q3", "tau0", "tau1", "tau2"], [*FROM_ONE, "dq0", "dq1", "dq2"]])
    def test_other_quantities_are_never_shifted_either(self, header: list[str]) -> None:
        with pytest.raises(DataError, match=r"'(tau0|dq0)', .* seem to count the joints from 0"):
            resolve_columns(header, ARM)
        with pytest.raises(DataError, match=r"'tau0', .* seem to count the joints from 0"):
            resolve_columns(["t", "a", "b", "c", *FROM_ZERO[4:]], ARM, {"q1": "a", "q2": "b", "q3": "c"})

    def test_mapped_positions_leave_one_that_does_not_fit(self) -> None:
        plan = resolve_columns(["t", "a", "b", "c", "q0"], ARM, {"q1": "a", "q2": "b", "q3": "c"})
        assert sources(plan) == {"q": ["a", "b", "c"]}

    def test_a_key_that_counts_from_zero(self) -> None:
        with pytest.raises(ConfigurationError, match=r"\[columns\] q0: joints are counted from 1"):
            resolve_columns(FROM_ONE, ARM, {"q0": "q1"})
