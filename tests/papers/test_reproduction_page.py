"""The page of a reproduction: all that was found is on it, sentences follow the numbers, bad findings are refused."""

import copy
import re

import numpy as np
import pytest
from made_up_reproduction import made_up_findings

from html_outline import HOSTILE, Outline
from truearm.errors import InputError
from truearm.pages.html import render
from truearm.papers.gao2017.phrases import range_cell
from truearm.papers.gao2017.reproduction_file import read_reproduction
from truearm.papers.gao2017.reproduction_page import reproduction_page

PARTS = {
    "figures.arm": ("The arm (Figures 1 and 2)", "--figure 1"),
    "figures.network": ("The network (Figure 3)", "--figure 3"),
    "tables.2": ("Table 2", "--table 2"),
    "tables.3": ("Table 3", "--table 3"),
    "tables.4": ("Table 4", "--table 4"),
    "figures.4": ("Some poses in detail (Figure 4)", "--figure 4"),
    "final_test": ("Error before and after (Figures 6 to 8)", "--table 4"),
    "figures.6": ("Error before and after (Figures 6 to 8)", "--figure 6"),
    "figures.7": ("Error before and after (Figures 6 to 8)", "--figure 7"),
    "figures.8": ("Error before and after (Figures 6 to 8)", "--figure 8"),
    "claims.learning_rate": ("The learning rate", "--table 2"),
    "claims.scatter": ("The scatter of starts", "--table 2"),
    "claims.boxes": ("The joint ranges", "--all"),
    "claims.outside": ("Outside the box", "--table 4"),
}


@pytest.fixture(scope="module")
def findings():
    return made_up_findings()


@pytest.fixture
def found(findings):
    return copy.deepcopy(findings)


@pytest.fixture(scope="module")
def page(findings):
    return reproduction_page(findings)


def put(found, place, value):
    """Set a value of nested findings; `place` is keys and numbers parted by dots, with / for a dot in a key."""
    *way, last = [int(key) if key.isdigit() and key not in "234678" else key for key in place.split(".")]
    for key in way:
        found = found[key]
    found[last.replace("/", ".") if isinstance(last, str) else last] = value


def page_of(found, *kept):
    """Make the page of some parts of findings; the others were not run."""
    for place in {*PARTS} - set(kept):
        put(found, place, None)
    return reproduction_page(found)


def section(page, title):
    return next(section for section in page.sections if section.title == title)


def words(text):
    """Give a text with plain spaces."""
    return re.sub(r"[\u202f\u00a0]", " ", text)


# What is on it -------------------------------------------------------------------------------------------------------


def test_every_part_of_the_findings_has_its_place(page):
    figures = {section.title: len(section.figures) for section in page.sections}
    assert figures == {
        "In short": 0,
        "The arm (Figures 1 and 2)": 2,
        "The network (Figure 3)": 1,
        "Table 2": 1,
        "Table 3": 1,
        "Table 4": 1,
        "Some poses in detail (Figure 4)": 1,
        "Error before and after (Figures 6 to 8)": 3,
        words("What 97 % means").replace(" %", "\u202f%"): 1,
        "The learning rate": 1,
        "The scatter of starts": 1,
        "The joint ranges": 1,
        "Outside the box": 1,
    }
    for figure in (figure for section in page.sections for figure in section.figures):
        assert len(figure.alt) > 40
        assert figure.caption.endswith(".")
    told = " ".join(figure.caption for section in page.sections for figure in section.figures)
    assert re.findall(r"Figure (\d) of the paper", told) == ["1", "2", "3", "4", "6", "7", "8"]


def test_the_page_is_well_formed_and_stands_alone(page):
    html = render(page)
    outline = Outline(html)
    assert len(outline.ids) == len(set(outline.ids))
    assert outline.tags.count("figure") == 15
    assert not re.search(r"https?://|@import|file:", html)
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", html, flags=re.DOTALL)
    # A picture of each drawn arm, network, table and claim is small: the page can be mailed.
    assert len(html.encode()) < 1_500_000


def test_tables_hold_every_row_with_the_papers_values_beside_ours(page, findings):
    for number, rows in findings["tables"].items():
        accuracy, effort = section(page, f"Table {number}").tables
        assert len(accuracy.rows) == len(effort.rows) == len(rows)
        heads = [(column.group, column.heading) for column in accuracy.columns]
        paper, ours = heads.index(("mean error", "paper")), heads.index(("mean error", "lm"))
        for row, line in zip(rows, accuracy.rows, strict=True):
            assert line[0] == row["row"]
            assert line[paper] == row["paper"]["mean_mm"]
            assert line[ours] == (None if row["ours"] is None else row["ours"]["median"]["mean_many_mm"])
        seconds = [(column.group, column.heading) for column in effort.columns].index(("training time", "paper"))
        assert [line[seconds] for line in effort.rows] == [row["paper"]["seconds"] for row in rows]


def test_settings_that_no_row_varies_stand_in_the_caption(page):
    two, three = (section(page, f"Table {n}").tables[1] for n in (2, 3))
    assert "goal" in [column.heading for column in two.columns]
    assert "goal" not in [column.heading for column in three.columns]
    assert "learning rate 0.01, goal 4e-9" in three.caption
    assert words(section(page, "Table 3").tables[0].caption).startswith("Table 3, accuracy, 9000 poses.")


def test_time_to_the_papers_error_is_the_median_of_the_starts_that_got_there(found):
    runs = found["tables"]["2"][0]["faithful"]["runs"]
    for run, seconds in zip(runs, (4.0, None, 2.0), strict=True):
        run["seconds_to_paper"] = seconds
    found["tables"]["2"] = found["tables"]["2"][:2]
    effort = section(page_of(found, "tables.2"), "Table 2").tables[1]
    where = [(column.group, column.heading) for column in effort.columns].index(
        ("time to the paper's mean error", "faithful")
    )
    assert effort.rows[0][where : where + 2] == (3.0, "2/3")


def test_notes_time_limits_and_repeated_trainings_are_told(found):
    found["tables"]["3"][1]["faithful"]["time_limit_s"] = 240
    page = page_of(found, "tables.2", "tables.3")
    assert "Row 9: Made up: a reading of the paper." in section(page, "Table 3").text
    assert "time limit 240 s in row 2" in words(section(page, "Table 3").text)
    accuracy = section(page, "Table 2").tables[0]
    where = [(column.group, column.heading) for column in accuracy.columns].index(("verdict", "faithful"))
    assert [line[where] for line in accuracy.rows[4:7]] == ["reproduced", "as row 1", "as row 1"]
    assert "Rule of the verdicts. Reproduced: the median" in section(page, "Table 2").text


def test_every_machine_and_the_time_of_the_trainings_are_facts(found):
    found["machines"].append({"cpu": "another", "cores": 1, "python": "3.12.1", "numpy": "2.4.6"})
    facts = reproduction_page(found).facts
    assert [words(told) for name, told in facts if name == "machine"] == [
        "made-up CPU, 2 cores, Python 3.11.7, NumPy 2.4.6",
        "another, 1 core, Python 3.12.1, NumPy 2.4.6",
    ]
    assert dict(facts)["version"] == "truearm 0.1.0"
    told = "3300 s (55 min), ended 2001-01-01T00:00:00+00:00 to 2001-01-01T01:00:00+00:00"
    assert words(dict(facts)["training time"]) == told


def test_the_range_is_that_of_the_means_on_2000_poses(page, findings):
    accuracy = section(page, "Table 4").tables[0]
    where = [(column.group, column.heading) for column in accuracy.columns].index(("mean error", "faithful")) + 1
    for row, line in zip(findings["tables"]["4"], accuracy.rows, strict=True):
        errors = [run["mean_many_mm"] for run in row["faithful"]["runs"]]
        assert line[where] == range_cell(errors)
    assert "median and range of the starts" in accuracy.caption


def test_wherever_the_two_are_compared_it_is_said_how_many_poses_each_fits(page):
    for title in ("In short", "Table 2", "Table 3", "Table 4", "Error before and after (Figures 6 to 8)"):
        assert "Faithful fits 70 % of the poses" in section(page, title).text


# Parts that were not run ---------------------------------------------------------------------------------------------


def test_findings_of_nothing_make_a_page_that_says_how_to_get_each_part(found):
    page = page_of(found)
    assert [part.title for part in page.sections] == ["In short", "The joint ranges", "Not part of this run"]
    told = page.sections[1].text + page.sections[2].text
    for place, (_, option) in PARTS.items():
        if place not in ("figures.6", "figures.7", "figures.8"):  # with the final test
            assert f"truearm reproduce gao2017 {option}" in told
    assert page.summary == ()
    assert all(not part.figures + part.tables for part in page.sections)
    assert Outline(render(page)).tags.count("h2") == len(page.sections) + 1


@pytest.mark.parametrize("place", ["tables.4", "claims.scatter", "figures.4", "figures.network"])
def test_one_part_alone_is_drawn(found, place):
    page = page_of(found, place)
    assert len(section(page, PARTS[place][0]).figures) == 1
    assert sum(len(part.figures) for part in page.sections) == 1
    assert "Not part of this run" in [part.title for part in page.sections]


def test_one_figure_of_the_final_test_is_drawn_without_the_others(found):
    page = page_of(found, "figures.7", "figures.8")
    part = section(page, "Error before and after (Figures 6 to 8)")
    assert [figure.caption[:8] for figure in part.figures] == ["Figure 7", "Figure 8"]
    assert "Figure 6 is not part of this run; it is made by: truearm reproduce gao2017 --figure 6" in part.text
    assert "The final test is not part of this run" in part.text


def test_a_row_that_was_not_run_keeps_its_place(found):
    found["tables"]["4"][0] |= {"faithful": None, "ours": None, "ratio": {"faithful": None, "ours": None}}
    found["tables"]["4"][0] |= {"verdict": "left out", "verdict_ours": "left out"}
    page = page_of(found, "tables.4")
    accuracy = section(page, "Table 4").tables[0]
    assert len(accuracy.rows) == 4
    assert accuracy.rows[0][-1] == "left out"
    assert "of 3 rows with lm" in section(page, "Table 4").text
    assert "3 rows of 4 were run" in section(page, "In short").text


def test_a_single_start_has_no_range():
    page = page_of(made_up_findings(seeds=1), "tables.4", "final_test")
    accuracy = section(page, "Table 4").tables[0]
    assert "range" not in [column.heading for column in accuracy.columns]
    assert "faithful: 1 start; lm: 1 start" in section(page, "Table 4").text
    assert "1 virtual arm the median" in words(section(page, "Error before and after (Figures 6 to 8)").text)


def test_what_a_quick_run_left_out_stands_at_the_end(found):
    found["quick"], found["left_out"] = True, ["Table 3 row 8: 675 s", "Table 3 row 6"]
    page = page_of(found)
    assert page.sections[-1].title == "What was left out"
    assert page.sections[-1].tables[0].rows == (("Table 3 row 8: 675 s",), ("Table 3 row 6",))
    assert "A quick run" in page.subtitle
    assert dict(page.facts)["extent"] == "quick; 2 parts left out"


# Sentences follow the numbers ----------------------------------------------------------------------------------------


def test_how_many_rows_reach_the_papers_accuracy_is_counted(found):
    for i, row in enumerate(found["tables"]["4"]):
        for run in row["faithful"]["runs"]:
            run["seconds_to_paper"] = None
        for k, run in enumerate(row["ours"]["runs"]):
            # Of three starts two are half or more, one is not.
            run["seconds_to_paper"] = 1.0 if k < (2 if i < 3 else 1) else None
    text = section(page_of(found, "tables.4"), "Table 4").text
    assert "reach the paper's mean error in 0 of 4 rows with faithful and in 3 of 4 rows with lm;" in text


def test_how_much_sooner_lm_is_there_is_the_median_of_rows(found):
    found["tables"]["2"] = found["tables"]["2"][:3]
    for row, times in zip(found["tables"]["2"], (2.0, 3.0, 10.0), strict=True):
        for name, seconds in (("faithful", times), ("ours", 1.0)):
            for run in row[name]["runs"]:
                run["seconds_to_paper"] = seconds
    page = page_of(found, "tables.2")
    text = section(page, "In short").text
    assert "In 3 rows both get there" in text
    assert "faithful then takes 3 times as long as lm in the median (from 2 to 10)" in text
    assert "Table 3 is not part of this run" in page.sections[-1].text
    assert [row.value for row in page.summary if row.unit == "times"] == [3.0]


def test_verdicts_are_counted_by_table(found):
    found["tables"]["3"][0]["verdict"] = "not reached"
    found["tables"]["4"][0]["verdict"] = "stopped by our limit"
    found["tables"]["4"][3] |= {"verdict": "used to fix the box", "verdict_ours": "used to fix the box"}
    page = page_of(found, "tables.3", "tables.4")
    table = section(page, "In short").tables[0]
    where = [(column.group, column.heading) for column in table.columns].index(("faithful, rows", "not reached"))
    assert [line[where] for line in table.rows] == [1, 0]
    assert page.summary[0].value == "13 of 14"  # of 16, one was cut short and one fixed the box
    assert page.summary[1].value == "13 of 13"  # two rows have no lm


def test_a_training_that_rows_share_counts_once(found):
    for row in found["tables"]["2"]:
        for name in ("faithful", "ours"):
            for run in row[name]["runs"]:
                run["seconds_to_paper"] = 1.0
    found["tables"]["2"][0] |= {"verdict": "used to fix the box"}
    page = page_of(found, "tables.2")
    assert page.summary[0].value == "10 of 10"  # 17 rows without 6 to 11 and the first
    assert page.summary[1].value == "11 of 11"
    text = words(section(page, "Table 2").text)
    assert "in 10 of 10 rows with faithful and in 11 of 11 rows with lm; rows that fixed the box" in text
    assert "In 11 rows both get there" in section(page, "In short").text


def test_gradient_descent_has_no_time_to_the_papers_error(found):
    for row in found["tables"]["3"]:
        for run in row["faithful"]["runs"]:
            run["seconds_to_paper"] = 1.0
    part = section(page_of(found, "tables.3"), "Table 3")
    effort = part.tables[1]
    where = [(column.group, column.heading) for column in effort.columns].index(
        ("time to the paper's mean error", "faithful")
    )
    assert [line[where] for line in effort.rows] == [1.0] * 10 + [None] * 2
    assert "in 10 of 10 rows with faithful" in part.text


def test_there_is_no_learning_rate(page):
    text = words(section(page, "The learning rate").text)
    assert "trainlm takes no learning rate. The paper's rows 1, 8 and 9, with the rates 0.01, 0.1, 1" in text
    assert "a mean error of 8.61 mm, the median of its starts; the paper's values go from 8.16 mm to 8.74 mm." in text
    assert "identical" not in text


def test_the_spread_of_starts_stands_beside_that_of_the_papers_values(found):
    found["claims"]["scatter"] |= {
        "mean_mm": [8.0, 9.0, 10.0],
        "mean_many_mm": [8.5, 9.0, 9.5],
        "relative_spread": 2 / 9,
        "paper_rows": [6, 7],
        "paper_rows_mean_mm": [10.0, 11.0],
        "paper_relative_spread": 1 / 10.5,
    }
    text = words(section(page_of(found, "claims.scatter"), "The scatter of starts").text)
    assert "mean errors from 8 mm to 10 mm" in text
    assert "From the least to the largest is 22.2 % of the median" in text
    assert "they spread over 9.50 % of theirs" in text
    assert "On 2000 poses the same starts go from 8.50 mm to 9.50 mm" in text
    assert "Only the spreads are compared" in text


def test_what_remains_of_the_rows_that_fixed_the_box_is_told(found):
    for row, ratio in zip(found["tables"]["2"], (2.0, 0.5, 8.0), strict=False):
        row |= {"verdict": "used to fix the box", "ratio": {"faithful": ratio, "ours": 1.0}}
    text = words(section(page_of(found, "tables.2"), "The joint ranges").text)
    # The cube root of 2 x 0.5 x 8.
    assert "the 3 rows of Table 2 that fixed it err, faithful, by 0.500 to 8 times the paper's average, 2 times" in text


def test_where_the_papers_values_are_met_and_what_a_wrong_box_does_is_told(found):
    found["claims"]["boxes"] |= {
        "half_width_deg": [20.0, 40.0, 60.0],
        "row1_mean_mm": [1.0, 4.0, 16.0],
        "row15_mean_mm": [1.0, 1.1, 1.2],
        "paper_row1": 8.0,
        "paper_row15": 5.0,
    }
    found["boxes"]["simulation_deg"] = 55
    text = words(section(page_of(found, "claims.boxes"), "The joint ranges").text)
    # The error doubles every 10 deg: 8 mm lies half way from 40 to 60 deg, and 5 deg are a factor of the root of 2.
    assert "8 mm, in a box of \u00b150 deg." in text
    assert re.search("The error is 8(.00)? mm at \u00b150 deg, 11.3 mm at \u00b155 deg, 16(.0)? mm at \u00b160", text)
    assert "Row 15 of Table 2 has the paper's mean error, 5 mm, in none of the boxes tried." in text


def test_from_where_on_lm_is_worse_than_nothing_is_told(found):
    found["claims"]["outside"] |= {
        "distance_deg": [0.0, 10.0, 20.0],
        "lm_median_mm": [0.01, 0.1, 10.0],
        "lm_p95_mm": [0.1, 1.0, 100.0],
        "nominal_median_mm": [1.0, 1.0, 1.0],
        "kinematic_median_mm": [0.01, 0.01, 0.02],
    }
    text = words(section(page_of(found, "claims.outside"), "Outside the box").text)
    assert "With the farthest joint 0 deg beyond the box the median of the errors of lm is 0.0100 mm" in text
    assert "From 15 deg on lm errs by more than the nominal arm." in text
    found["claims"]["outside"]["nominal_median_mm"] = [50.0] * 3
    text = words(section(page_of(found, "claims.outside"), "Outside the box").text)
    assert "of the uncompensated nominal arm 50 mm and 50 mm" in text
    assert "From" not in text


def test_a_share_is_told_with_what_is_left_and_the_floor(found):
    for run in found["final_test"]["runs"]:
        run |= {"nominal": {"mean_mm": 1.0, "max_mm": 2.0}, "noise_floor_mm": 0.02}
        run["ours"]["mean_mm"] = 0.03
    page = page_of(found, "final_test")
    text = words(section(page, "What 97\u202f% means").text)
    assert "With lm 97 % removed of a mean error of 1 mm leaves 0.0300 mm" in text
    assert "more than 98 % could not be removed, and the error of lm is 1.50 times that floor" in text
    assert "0.100 mm, the same 0.0300 mm left would be 70 % removed" in text
    for run in found["final_test"]["runs"]:
        run["ours"] = None
    assert "What a share removed means is not part of this run" in page_of(found, "final_test").sections[-1].text


# Bad findings --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("truearm", "findings of a reproduction: truearm: Field required"),
        ("machines.[0].cpu", "machines.0.cpu: Field required"),
        ("tables.2.[0].paper.mean_mm", "tables.2.0.paper.mean_mm: Field required"),
        ("claims.outside.lm_p95_mm", "claims.outside.lm_p95_mm: Field required"),
        ("final_test.runs.[1].ours.over_0/05", "final_test.runs.1.ours.over_0.05: Field required"),
    ],
)
def test_a_missing_key_is_named_with_its_place(found, place, told):
    *way, last = (int(key[1:-1]) if key[0] == "[" else key.replace("/", ".") for key in place.split("."))
    inner = found
    for key in way:
        inner = inner[key]
    del inner[last]
    with pytest.raises(InputError, match=re.escape(told)):
        read_reproduction(found)


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        ("training_seconds", float("nan"), "training_seconds: .*"),
        ("training_seconds", -1.0, "training_seconds: .*greater than or equal to 0"),
        ("training_seconds", "12", "training_seconds: .*number"),
        ("training_seconds", 1e300, "training_seconds: .*less than"),
        ("machines", [], "machines: .*at least 1"),
        ("truearm", "x" * 5000, "truearm: .*at most 4000 characters"),
        ("figures.6", {"deviation_mm": [[1.0, None]]}, "figures.6.deviation_mm.0.1: .*"),
        ("claims.outside.lm_median_mm", 3.0, "claims.outside.lm_median_mm: .*list"),
    ],
)
def test_a_bad_value_is_named_with_its_place(found, place, value, told):
    put(found, place, value)
    with pytest.raises(InputError, match=told):
        read_reproduction(found)


@pytest.mark.parametrize("found", [None, [], "x", {1: 2}])
def test_what_are_no_findings_is_refused(found):
    with pytest.raises(InputError, match="findings of a reproduction"):
        reproduction_page(found)


def test_texts_of_the_findings_are_text_and_not_markup(found):
    found |= {"truearm": HOSTILE, "left_out": [HOSTILE], "rule": HOSTILE, "trained": [HOSTILE]}
    found["machines"][0]["cpu"] = found["boxes"]["how"] = found["claims"]["scatter"]["what"] = HOSTILE
    for row in found["tables"]["4"]:
        row |= {"verdict": HOSTILE, "verdict_ours": HOSTILE, "note": HOSTILE, "activation": HOSTILE}
        row["paper"]["trainer"] = HOSTILE
        for run in row["faithful"]["runs"]:
            run["stop"] = HOSTILE
    found["figures"]["4"]["predicted_mm"] = {HOSTILE: found["figures"]["4"]["points_mm"], "ours": None}
    html = render(page_of(found, "tables.4", "claims.scatter", "figures.4"))
    assert "script" not in Outline(html).tags
    assert html.count("&lt;script&gt;") > 10


def test_numbers_far_apart_are_drawn(found):
    # Between the least and the largest that a finding may have, on logarithmic scales, in every picture of numbers.
    random = np.random.default_rng(2)
    for row in found["tables"]["4"]:
        row["paper"] |= {"mean_mm": 1e-11, "seconds": 0.0}
        for run in row["faithful"]["runs"]:
            run["mean_many_mm"] = float(10 ** random.uniform(-11, 11))
            run["seconds_to_paper"] = 0.0
    found["claims"]["scatter"]["mean_mm"] = [1.0] * 30
    page = page_of(found, "tables.4", "claims.scatter")
    assert Outline(render(page)).tags.count("figure") == 2
