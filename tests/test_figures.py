"""Laws of the guide's figures: what a page quotes is what its benchmark gave."""

import importlib
import json
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


@pytest.fixture
def figures(monkeypatch):
    """The module."""
    if not (CHECKOUT / "benchmarks").is_dir():
        pytest.skip("benchmarks are not beside the tests")
    monkeypatch.syspath_prepend(CHECKOUT)
    return importlib.import_module("benchmarks.figures")


@pytest.fixture
def own_figures(figures, tmp_path, monkeypatch):
    """The module, with figures of its own in an empty folder."""
    monkeypatch.setattr(figures, "KEPT", tmp_path)
    table = [{"arm": "nominal", "mean_mm": 0.7496602}, {"arm": "exported", "mean_mm": 0.3767}]
    targets = [{"what": "mean", "reached": 0.3767, "limit": 0.385, "good": "below", "met": True}]
    row = {"what": "errors", "command": "python -m benchmarks exports urdf", "options": {}, "cpu_seconds": 1.0}
    figures.keep("exports", {"urdf": row | {"table": table, "targets": targets, "notes": ["a note"]}})
    return figures


def test_every_page_quotes_what_is_kept(figures):
    """Every mark is found, and the text before it is its figure: `python -m benchmarks figures pages` writes them."""
    for page in figures.guide():
        text = page.read_text(encoding="utf-8")
        assert figures.filled(text) == text, page.name


def test_every_kept_row_is_one_of_its_benchmark_and_says_where_it_was_measured(figures):
    """Benchmark, row, commit, machine."""
    kept = figures.kept_rows()
    assert kept
    for (benchmark, row), entry in kept.items():
        assert row in importlib.import_module(f"benchmarks.{benchmark}").ROWS, (benchmark, row)
        assert {"command", "commit", "day", "machine", "code", "table", "targets", "notes"} <= set(entry)
        assert entry["commit"], (benchmark, row)
        assert entry["code"] or entry["cpu_seconds"] is None, (benchmark, row)  # typed before figures were kept


def test_a_number_keeps_its_decimals_and_a_page_without_marks_is_as_it_was(own_figures):
    """Numbers of tables and of targets."""
    page = "{}<!-- exports urdf > nominal > mean_mm --> mm, {}<!-- exports urdf > mean > reached -->, 3.25 mm"
    filled = own_figures.filled(page.format("9.99", "1"))
    assert filled == page.format("0.75", "0")
    assert own_figures.filled(filled) == filled


def test_a_table_has_its_lines_verdict_notes_and_source(own_figures):
    """All columns, or those named; twice is once."""
    page = "<!-- figures: exports urdf; columns: mean_mm -->\nold\n<!-- end -->\nafter"
    filled = own_figures.filled(page)
    assert "| mean_mm |\n| --- |\n| 0.7497 |\n| 0.3767 |" in filled
    assert "mean: 0.3767 (<= 0.385): met" in filled
    assert "a note" in filled
    assert "old" not in filled
    assert "`python -m benchmarks exports urdf`, commit " in filled
    assert filled.endswith("<!-- end -->\nafter")
    assert own_figures.filled(filled) == filled
    assert "| arm | mean_mm |" in own_figures.filled("<!-- figures: exports -->\n<!-- end -->")


@pytest.mark.parametrize(
    "mark",
    [
        "1<!-- house urdf > nominal > mean_mm -->",
        "1<!-- exports json > nominal > mean_mm -->",
        "1<!-- exports urdf > drawn > mean_mm -->",
        "1<!-- exports urdf > nominal > max_mm -->",
        "<!-- figures: exports json -->\n<!-- end -->",
    ],
)
def test_a_figure_that_is_not_kept_is_an_error(own_figures, mark):
    """No benchmark, row, line or column of the name."""
    with pytest.raises(LookupError):
        own_figures.filled(mark)


def test_a_row_is_stale_once_its_code_has_changed(own_figures, tmp_path, monkeypatch):
    """A room that changed or went is named; others are not."""
    assert list(own_figures.stale()) == []
    file = tmp_path / "exports.json"
    kept = json.loads(file.read_text(encoding="utf-8"))
    room = next(iter(kept["urdf"]["code"]))
    kept["urdf"]["code"] |= {room: "0" * 12, "gone": "0" * 12}
    file.write_text(json.dumps(kept), encoding="utf-8")
    (line,) = own_figures.stale()
    assert set(line["changed since"].split(", ")) == {room, "gone"}


def test_times_may_scatter_more_than_values(own_figures):
    """By half and by 2 %."""
    assert not own_figures.differs("fit, CPU [s]", 1.0, 1.4)
    assert own_figures.differs("fit, CPU [s]", 1.0, 2.1)
    assert not own_figures.differs("mean_mm", 1.0, 1.019)
    assert own_figures.differs("mean_mm", 1.0, 1.03)
    assert own_figures.differs("arm", "a", "b")
    assert own_figures.differs("mean_mm", 1.0, None)


def test_no_figures_of_the_smallest_sizes_are_kept(figures, monkeypatch, capsys):
    """`--keep --quick` is refused."""
    del figures
    command = importlib.import_module("benchmarks.__main__")
    with pytest.raises(SystemExit):
        command.main(["house", "--quick", "--keep"])
    assert "--keep" in capsys.readouterr().err
