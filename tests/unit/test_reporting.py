"""Reports as data, as figures and as pages."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ident.drawing.document import BlockKind, Figure, Layer, Panel, Report, Role, Table, Text, percent, plain, read_report, uncertain
from ident.drawing.html import to_html
from ident.errors import ConfigurationError
from ident.reporting import report, report_of
from ident.signals.timeline import Timeline, binned, cloud

NAN = float("nan")


def document() -> Report:
    x = np.linspace(0, 1, 20)
    y = np.where(x > 0.5, np.nan, x)
    layers = (
        Layer.of(BlockKind.SPAN, Role.FLOOR, (0.2, 0.4), label="held out"),
        Layer.of(BlockKind.BAND, Role.BEFORE, x, y, y + 1, label="before"),
        Layer.of(BlockKind.POINTS, Role.AFTER, x, y),
        Layer.of(BlockKind.LINE, Role.EFFECT, x, y, label="effect"),
        Layer.of(BlockKind.LINE, Role.MEASURED, x, x, label="measured"),
    )
    figure = Figure("one", "A <figure>", "what is seen", (Panel("p", "x", "y", layers),) * 3, columns=2)
    long = Table("Long", ("a", "b"), tuple((f"r{i}", f"{i}") for i in range(30)), "a note & more")
    return Report("Clean: <nothing>", "clean", "arm & base", (Text("Words", ("one", "two")), long, figure))


def test_kept_and_read_again(tmp_path):
    made = document()
    (tmp_path / "r.json").write_text(made.to_json())
    again = read_report(tmp_path / "r.json")
    assert again == made
    assert again.figures[0].panels[0].layers[1].y[-1] is None, "what is not finite breaks the line"
    for text in ("{", '{"schema": "ident.fit/1"}', json.dumps({**made.to_dict(), "sections": [{"section": "poem"}]})):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises(ConfigurationError, match=r"bad\.json"):
            read_report(tmp_path / "bad.json")


def test_page_escapes_and_marks_long_tables():
    pytest.importorskip("matplotlib")
    page = to_html(document())
    assert "<title>Clean: &lt;nothing&gt;</title>" in page
    assert "arm &amp; base" in page
    assert 'alt="A &lt;figure&gt;"' in page
    assert page.count('class="long"') == 1
    assert page == to_html(document()), "the same report gives the same page"


def test_files(tmp_path):
    pytest.importorskip("matplotlib")
    made = report(document(), tmp_path / "r.html", figures=tmp_path / "figures")
    assert made.read_text().startswith("<!DOCTYPE html>")
    assert [p.name for p in (tmp_path / "figures").iterdir()] == ["one.svg"]
    with pytest.raises(ConfigurationError, match="nothing was written"):
        report(document(), tmp_path / "r.html")
    report(document(), tmp_path / "r.html", figures=tmp_path / "figures", force=True)
    with pytest.raises(ConfigurationError, match="no report of a dict"):
        report_of({})


def test_a_band_of_single_rows_is_still_seen():
    """Few rows over a long time: least and greatest value of a stretch are the same, and a band without an edge would vanish."""
    pytest.importorskip("matplotlib")
    from ident.drawing.figures import COLOURS, draw

    t = np.arange(20.0)
    layer = Layer.of(BlockKind.BAND, Role.BEFORE, t, t, t, label="before")
    svg = draw(Figure("f", "f", "", (Panel("p", "x", "y", (layer,)),))).decode()
    drawn = [part for part in svg.split("<g ") if "FillBetween" in part or "PolyCollection" in part]
    assert any(f"stroke: {COLOURS[Role.BEFORE].lower()}" in part.lower() for part in drawn)


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.123456, 0.0021, "0.1235 ± 0.0021"),
        (-12.3456, 0.5, "-12.35 ± 0.50"),
        (1234.5, 12.0, "1234 ± 12"),
        (1.5, NAN, "1.5"),
        (1.5, 0.0, "1.5"),
        (1.5, np.inf, "1.5"),
        (3e7, 2e5, "3e+07 ± 2e+05"),
        (2e-9, 1e-10, "2e-09 ± 1e-10"),
    ],
)
def test_as_many_digits_as_the_std_bears(value, std, text):
    assert uncertain(value, std) == text


def test_numbers_that_are_not_there_are_dashes():
    assert (percent(0.12345), percent(NAN), plain(NAN), plain(0.012345)) == ("12.35", "–", "–", "0.0123")


def signals(t: list[np.ndarray]) -> SimpleNamespace:
    ends = np.cumsum([0, *map(len, t)])
    runs = tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))
    return SimpleNamespace(row_time=np.concatenate(t), row_runs=runs)


def test_runs_one_after_the_other():
    line = Timeline.of([signals([np.arange(5.0), 100 + np.arange(3.0)]), signals([np.arange(4.0)])])
    assert np.all(np.diff(line.t) > 0)
    assert [e.stop - e.start for e in line.edges] == [5, 3, 4]
    (a, b), (c, d) = line.starts
    assert a == 0
    assert b < c < d
    values = np.r_[np.arange(8.0), np.full(4, np.nan)]
    t, low, high = line.envelope(values)
    assert np.nanmax(high) == 7
    assert np.nanmin(low) == 0
    assert np.isnan(low[t > c]).all(), "rows that are not used leave a gap"


def test_points_and_bins_leave_nothing_odd():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, 5000)
    y = 3 * x + rng.normal(size=5000)
    y[:100] = np.nan
    cx, cy = cloud(x, y)
    assert len(cx) == len(cy) == 1200
    assert np.isfinite(cy).all()
    bx, by = binned(x, y)
    assert by == pytest.approx(3 * bx, abs=0.6)
    assert len(binned(np.ones(100), y[:100])[0]) == 0
    assert len(binned(np.zeros(0), np.zeros(0))[0]) == 0


def test_the_motor_of_a_coupling_is_named():
    from ident import make_effect
    from ident.diagnosis import CompetingModel, Finding
    from ident.diagnosis.pictures import findings_section
    from ident.reporting.diagnosis import _competing, headline

    effect = make_effect("gear_coupling", joints=("j6",), motors=("j5",))
    finding = Finding(
        effect, ("j6",), (), 0.5, 100.0, 0.9, (CompetingModel("offset", ("j6",), 0.05, (), 0.8, (("offset_j6", -3.2, "N m"),)),)
    )
    d = SimpleNamespace(verdict="explained", findings=(finding,), unexplained=())
    assert headline(d) == "Explained: the model lacks gear_coupling on j6 (motor of j5)"
    assert _competing(d)[0].rows[0] == ("1. gear_coupling on j6 (motor of j5)", "offset on j6", "-3.2 N m", "80 %", "0.050")
    assert findings_section(replace_parameters(d))[0].rows[0][2] == "j6 (motor of j5)"


def replace_parameters(d: SimpleNamespace) -> SimpleNamespace:
    from ident.diagnosis import FoundParameter

    parameter = FoundParameter("K_j6_j5", 0.1, 0.01, "rad/rad")
    return SimpleNamespace(findings=tuple(replace(f, parameters=(parameter,)) for f in d.findings))
