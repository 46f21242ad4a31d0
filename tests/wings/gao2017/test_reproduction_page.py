"""The page of a reproduction: it has every result, its sentences follow the numbers, and it names missing parts."""

import re
from dataclasses import replace

import numpy as np
import pytest
from made_up_reproduction import made_up_results

from browser import Tab
from frame_laws import check_frame
from html_outline import HOSTILE, Outline
from truearm.pages.html import render, write_page
from truearm.wings.gao2017.phrases import range_cell
from truearm.wings.gao2017.reproduce import ReproductionResult
from truearm.wings.gao2017.reproduction_page import paper_figure, reproduction_page
from truearm.wings.gao2017.results import TIME_OVER, Claims, FigureData, TrainerResult

PARTS = {
    "figures.arm": ("The arm (Figures 1 and 2)", "--figure 1"),
    "figures.network": ("The network (Figure 3)", "--figure 3"),
    "tables.2": ("Table 2", "--table 2"),
    "tables.3": ("Table 3", "--table 3"),
    "tables.4": ("Table 4", "--table 4"),
    "figures.figure_4": ("Some poses in detail (Figure 4)", "--figure 4"),
    "final_test": ("Error before and after (Figures 6 to 8)", "--table 4"),
    "figures.figure_6": ("Error before and after (Figures 6 to 8)", "--figure 6"),
    "figures.figure_7": ("Error before and after (Figures 6 to 8)", "--figure 7"),
    "figures.figure_8": ("Error before and after (Figures 6 to 8)", "--figure 8"),
    "claims.learning_rate": ("The learning rate", "--table 2"),
    "claims.scatter": ("The scatter of starts", "--table 2"),
    "claims.boxes": ("The joint ranges", "--all"),
    "claims.outside": ("Outside the box", "--table 4"),
}


@pytest.fixture(scope="module")
def results():
    return made_up_results()


@pytest.fixture(scope="module")
def page(results):
    return reproduction_page(results)


def only(results, *kept, **changed):
    """Some parts of a reproduction; the others were not run."""

    def parts(record, name):
        return {key: getattr(record, key) for key in vars(record) if f"{name}.{key}" in kept}

    return replace(
        results,
        tables={number: rows if f"tables.{number}" in kept else None for number, rows in results.tables.items()},
        final_test=results.final_test if "final_test" in kept else None,
        claims=Claims(**parts(results.claims, "claims")),
        figures=FigureData(**parts(results.figures, "figures")),
        **changed,
    )


def with_table(results, number, rows):
    return replace(results, tables={**results.tables, number: tuple(rows)})


def with_claim(results, name, **changed):
    claim = replace(getattr(results.claims, name), **changed)
    return replace(results, claims=replace(results.claims, **{name: claim}))


def with_times(row, **times):
    """A row whose starts reach the paper's error at other times: a list, or one time for all starts."""
    new = dict(row.results)
    for name, seconds in times.items():
        if (result := row.results[name]) is not None:
            each = seconds if isinstance(seconds, list) else [seconds] * len(result.runs)
            runs = [replace(run, seconds_to_paper=s) for run, s in zip(result.runs, each, strict=True)]
            new[name] = TrainerResult.of(result.trainer, runs, time_limit_s=None)
    return replace(row, results=new)


def section(page, title):
    return next(section for section in page.sections if section.title == title)


def words(text):
    """Give a text with plain spaces."""
    return re.sub(r"[\u202f\u00a0]", " ", text)


def heads(table):
    return [(column.group, column.heading) for column in table.columns]


# Contents ------------------------------------------------------------------------------------------------------------


def test_every_result_has_its_section(page):
    figures = {words(section.title): len(section.figures) + len(section.scenes) for section in page.sections}
    assert figures == {
        "In short": 0,
        "Where the networks err": 1,
        "Table 2": 1,
        "Table 3": 1,
        "Table 4": 1,
        "Learning curves": 1,
        "Error before and after (Figures 6 to 8)": 3,
        "What 97 % means": 1,
        "The learning rate": 1,
        "The scatter of starts": 1,
        "The joint ranges": 2,
        "Outside the box": 1,
        "The arm (Figures 1 and 2)": 2,
        "The network (Figure 3)": 1,
        "Some poses in detail (Figure 4)": 2,
    }
    shown = [
        *(figure for section in page.sections for figure in section.figures),
        *(scene.still for section in page.sections for scene in section.scenes),
    ]
    for figure in shown:
        assert len(figure.alt) > 40
        assert figure.caption.endswith(".")
    captions = " ".join(figure.caption for figure in shown)
    assert sorted(re.findall(r"Figure (\d) of the paper", captions)) == ["1", "2", "3", "4", "6", "7", "8"]


@pytest.mark.parametrize("number", [1, 2, 3, 4, 6, 7, 8])
def test_each_figure_of_the_paper_is_on_the_page(page, number):
    assert paper_figure(page, number).caption.startswith(f"Figure {number} of the paper")
    assert paper_figure(page, 5) is None


def test_the_page_is_well_formed_and_needs_no_other_file(page):
    html = render(page)
    outline = Outline(html)
    assert len(outline.ids) == len(set(outline.ids))
    assert outline.tags.count("figure") == 19
    assert not re.search(r"https?://|@import|file:", html)
    text = re.sub(r"<svg.*?</svg>", "", html, flags=re.DOTALL)
    assert "nan" not in text
    assert not re.search("[\u2212-]0(\\.0*)?[<\u202f ]", text)  # zero has no sign
    # The figures are small, so that the page can be mailed.
    assert len(html.encode()) < 1_500_000


def test_the_verdict_counts_the_rows_and_trainings_that_were_cut_make_it_doubtful(page, results):
    assert page.verdict.state == "good"
    sentence = "The paper's accuracy is reached or surpassed in 27 of 27 judged table rows with trainlm and in 25"
    assert page.verdict.sentence.startswith(sentence)
    rows = list(results.tables[4])
    missed = replace(rows[0], verdict=rows[0].verdict | {"varpro": "not reached"})
    page = reproduction_page(only(with_table(results, 4, [missed, *rows[1:]]), "tables.4"))
    assert page.verdict.state == "doubtful"
    assert "3 of 4 judged table rows with varpro" in page.verdict.sentence
    longest = rows[2]
    runs = [replace(run, stop=TIME_OVER) for run in longest.results["varpro"].runs]
    of_row = longest.results | {"varpro": TrainerResult.of("varpro", runs, time_limit_s=9.0)}
    rows[2] = replace(longest, results=of_row)
    page = reproduction_page(only(with_table(results, 4, rows), "tables.4"))
    assert page.verdict.state == "doubtful"
    assert "time limit cut trainings of 1 row" in page.verdict.detail
    assert [row.state for row in page.summary[:2]] == ["none", "doubtful"]
    (curves,) = section(page, "Learning curves").figures
    assert "An open mark" in curves.caption
    assert reproduction_page(only(results)).verdict is None


def test_tables_and_drawings_are_folded(page):
    for title in ("Table 2", "Table 3", "Table 4"):
        assert all(table.folded for table in section(page, title).tables)
    open_ = [part.title for part in page.sections if not part.folded]
    assert [words(title) for title in open_] == [
        *("In short", "Where the networks err", "Table 2", "Table 3", "Table 4"),
        *("Learning curves", "What 97 % means", "Outside the box"),
    ]


def test_the_folded_page_is_no_taller_than_7000_pixels(page, chromium, tmp_path):
    # It was 17,800 with every table and drawing open; 800 of them are the view of the test poses.
    write_page(page, tmp_path / "page.html")
    with Tab(chromium, tmp_path / "page.html", width=1400) as tab:
        assert tab.page.evaluate("document.documentElement.scrollHeight") <= 7000


def test_the_test_poses_are_in_space_with_their_errors_and_the_arm_goes_to_them(results, page):
    (scene,) = section(page, "Where the networks err").scenes
    final = {**results.figures.figure_6.deviations(), **results.figures.figure_7.deviations()}
    for column, (name, deviation) in zip(scene.cloud.values, final.items(), strict=True):
        assert column.name == f"error, {name}"
        np.testing.assert_allclose(column.values, np.sqrt((deviation**2).sum(axis=1)), rtol=1e-12)
    assert scene.cloud.values[scene.cloud.shown].name == "error, varpro"
    (worst,) = scene.cloud.marked
    assert worst == np.argmax(np.linalg.norm(final["varpro"], axis=1))
    np.testing.assert_allclose(scene.mechanism.start, results.figures.figure_7.angles_deg[worst], rtol=1e-12)
    # Without the final test the poses of Figure 4 are shown, and without these the arm alone.
    (few,) = section(reproduction_page(only(results, "figures.figure_4")), "Where the networks err").scenes
    assert len(few.cloud.names) == len(results.figures.figure_4.points_mm)
    alone = reproduction_page(only(results, "figures.arm"))
    assert "Where the networks err" not in [part.title for part in alone.sections]
    arm = section(alone, "The arm (Figures 1 and 2)")
    assert (arm.folded, arm.scenes[0].cloud, arm.scenes[0].mechanism.controls) == (False, None, True)


def test_a_table_without_a_judged_row_has_no_share(results):
    row = results.tables[2][0]
    quick = replace(row, verdict=dict.fromkeys(row.verdict, "used to fit the box"))
    page = reproduction_page(with_table(only(results), 2, [quick]))
    assert not [one for one in page.summary if "reproduced or better" in one.label]


def test_learning_curves_show_the_longest_training_of_each_table(page, results):
    (figure,) = section(page, "Learning curves").figures
    titles = [panel.axes[0].get_title(loc="left").partition(":")[0] for panel in figure.panels]
    longest = {number: max(rows, key=lambda row: row.paper.seconds) for number, rows in results.tables.items()}
    assert titles == [f"Table {number}, row {row.paper.row}" for number, row in longest.items()]
    line = figure.panels[2].axes[0].lines[0]
    _, seconds, error = longest[4].results["trainlm"].runs[0].curve[-1]
    assert line.get_xydata()[-1].tolist() == [seconds, error]
    # Results of earlier versions have none, which is no fault.
    rows = [
        replace(
            row,
            results={
                name: one and TrainerResult.of(name, [replace(run, curve=()) for run in one.runs], time_limit_s=None)
                for name, one in row.results.items()
            },
        )
        for row in results.tables[4]
    ]
    page = reproduction_page(only(with_table(results, 4, rows), "tables.4"))
    assert "Learning curves" not in [part.title for part in page.sections]


def test_tables_have_every_row_with_the_papers_values_beside_ours(page, results):
    for number, rows in results.tables.items():
        accuracy, effort = section(page, f"Table {number}").tables
        assert len(accuracy.rows) == len(effort.rows) == len(rows)
        paper, ours = heads(accuracy).index(("mean error", "paper")), heads(accuracy).index(("mean error", "varpro"))
        for row, line in zip(rows, accuracy.rows, strict=True):
            assert line[0] == row.paper.row
            assert line[paper] == row.paper.mean_mm
            varpro = row.results["varpro"]
            assert line[ours] == (None if varpro is None else varpro.median["mean_many_mm"])
        seconds = heads(effort).index(("training time", "paper"))
        assert [line[seconds] for line in effort.rows] == [row.paper.seconds for row in rows]


def test_settings_that_no_row_varies_are_in_the_caption(page):
    two, three = (section(page, f"Table {n}").tables[1] for n in (2, 3))
    assert "goal" in [column.heading for column in two.columns]
    assert "goal" not in [column.heading for column in three.columns]
    assert "learning rate 0.01, goal 4e-9" in three.caption
    assert words(section(page, "Table 3").tables[0].caption).startswith("Table 3, accuracy, 9000 poses.")


def test_time_to_the_papers_error_is_the_median_of_the_starts_that_reach_it(results):
    first, second = results.tables[2][:2]
    results = only(with_table(results, 2, [with_times(first, trainlm=[4.0, None, 2.0]), second]), "tables.2")
    effort = section(reproduction_page(results), "Table 2").tables[1]
    where = heads(effort).index(("time to the paper's mean error", "trainlm"))
    assert effort.rows[0][where : where + 2] == (3.0, "2/3")


def test_notes_time_limits_and_repeated_trainings_are_stated(results):
    rows = list(results.tables[3])
    limited = replace(rows[1].results["trainlm"], time_limit_s=240.0)
    rows[1] = replace(rows[1], results=rows[1].results | {"trainlm": limited})
    page = reproduction_page(only(with_table(results, 3, rows), "tables.2", "tables.3"))
    assert "Row 9: Made up: a reading of the paper." in section(page, "Table 3").text
    assert "time limit 240 s in row 2" in words(section(page, "Table 3").text)
    accuracy = section(page, "Table 2").tables[0]
    where = heads(accuracy).index(("verdict", "trainlm"))
    assert [line[where] for line in accuracy.rows[4:7]] == ["reproduced", "as row 1", "as row 1"]
    assert "Rule of the verdicts. Reproduced: the median" in section(page, "Table 2").text


def test_every_machine_and_the_time_of_the_trainings_are_facts(results):
    machines = [*results.machines, {"cpu": "another", "cores": 1, "python": "3.12.1", "numpy": "2.4.6"}]
    facts = reproduction_page(replace(results, machines=machines)).facts
    assert [words(text) for name, text in facts if name == "machine"] == [
        "made-up CPU, 2 cores, Python 3.11.7, NumPy 2.4.6",
        "another, 1 core, Python 3.12.1, NumPy 2.4.6",
    ]
    assert dict(facts)["version"] == "truearm 0.1.0"
    time = "3300 s (55 min), ended 2001-01-01T00:00:00+00:00 to 2001-01-01T01:00:00+00:00"
    assert words(dict(facts)["training time"]) == time


def test_the_range_is_that_of_the_means_on_2000_poses(page, results):
    accuracy = section(page, "Table 4").tables[0]
    where = heads(accuracy).index(("mean error", "trainlm, range"))
    for row, line in zip(results.tables[4], accuracy.rows, strict=True):
        assert line[where] == range_cell([run.mean_many_mm for run in row.results["trainlm"].runs])
    assert "median and range of the starts" in accuracy.caption


def test_every_comparison_states_how_many_poses_each_trainer_fits(page):
    for title in ("In short", "Table 2", "Table 3", "Table 4", "Error before and after (Figures 6 to 8)"):
        assert "trainlm fits 70 % of the poses" in section(page, title).text


def test_joints_are_named_by_number_and_theta_is_never_minus_zero(page):
    table = section(page, "The arm (Figures 1 and 2)").tables[0]
    assert [row[0] for row in table.rows] == [f"J{i}" for i in range(1, 7)]
    assert [row[3] for row in table.rows] == [0, -120, 0, 75, 0, -30]
    assert "J1 = 0 deg" in words(section(page, "The arm (Figures 1 and 2)").text)


# Parts that were not run ---------------------------------------------------------------------------------------------


def test_an_empty_reproduction_makes_a_page_that_names_the_command_for_each_part(results):
    page = reproduction_page(only(results))
    assert [part.title for part in page.sections] == ["In short", "The joint ranges", "Not part of this run"]
    text = page.sections[1].text + page.sections[2].text
    for place, (_, option) in PARTS.items():
        if place not in ("figures.figure_6", "figures.figure_7", "figures.figure_8"):  # with the final test
            assert f"truearm reproduce gao2017 {option}" in text
    assert page.summary == ()
    assert all(not part.figures + part.tables for part in page.sections)
    assert Outline(render(page)).tags.count("h2") == len(page.sections) + 1


@pytest.mark.parametrize("place", ["tables.4", "claims.scatter", "figures.figure_4", "figures.network"])
def test_one_part_alone_is_drawn(results, place):
    page = reproduction_page(only(results, place))
    of_part = 1 + (place == "figures.figure_4")  # its coordinates, and their errors
    assert len(section(page, PARTS[place][0]).figures) == of_part
    assert sum(len(part.figures) for part in page.sections) == of_part + (place == "tables.4")  # its learning curves
    assert "Not part of this run" in [part.title for part in page.sections]


def test_one_figure_of_the_final_test_is_drawn_without_the_others(results):
    page = reproduction_page(only(results, "figures.figure_7", "figures.figure_8"))
    part = section(page, "Error before and after (Figures 6 to 8)")
    assert [figure.caption[:8] for figure in part.figures] == ["Figure 7", "Figure 8"]
    assert "Figure 6 is not part of this run. To make it: truearm reproduce gao2017 --figure 6" in part.text
    assert "The final test is not part of this run" in part.text


def test_a_skipped_row_keeps_its_place(results):
    none = dict.fromkeys(("trainlm", "varpro"))
    first = replace(results.tables[4][0], results=none, ratio=none, verdict=dict.fromkeys(none, "skipped"))
    page = reproduction_page(only(with_table(results, 4, [first, *results.tables[4][1:]]), "tables.4"))
    accuracy = section(page, "Table 4").tables[0]
    assert len(accuracy.rows) == 4
    assert accuracy.rows[0][-1] == "skipped"
    assert "of 3 rows with varpro" in section(page, "Table 4").text
    assert "3 rows of 4 were run" in section(page, "In short").text
    for trainer in none:
        assert f"{trainer} ran 3 of 4 rows, without Table 4 row 1." in page.verdict.detail


def test_the_tables_are_a_data_frame(results):
    rows = [row for rows in results.tables.values() for row in rows]
    frame = check_frame(
        ReproductionResult(results, ()), sum(one is not None for row in rows for one in row.results.values())
    )
    assert set(frame["table"]) == {2, 3, 4}


def test_a_single_start_has_no_range():
    page = reproduction_page(only(made_up_results(seeds=1), "tables.4", "final_test"))
    accuracy = section(page, "Table 4").tables[0]
    assert not [column for column in accuracy.columns if "range" in column.heading]
    assert "trainlm: 1 start; varpro: 1 start" in section(page, "Table 4").text
    assert "median on 1 virtual arm:" in words(section(page, "Error before and after (Figures 6 to 8)").text)


def test_skipped_parts_of_a_quick_run_are_listed_at_the_end(results):
    page = reproduction_page(only(results, quick=True, skipped=["Table 3 row 8: 675 s", "Table 3 row 6"]))
    assert page.sections[-1].title == "Skipped parts"
    assert page.sections[-1].tables[0].rows == (("Table 3 row 8: 675 s",), ("Table 3 row 6",))
    assert "A quick run" in page.subtitle
    assert dict(page.facts)["extent"] == "quick; 2 parts skipped"


# Sentences follow the numbers ----------------------------------------------------------------------------------------


def test_rows_that_reach_the_papers_accuracy_are_counted(results):
    rows = [
        # Of three starts two are half or more, one is not.
        with_times(row, trainlm=None, varpro=[1.0, 1.0, None] if i < 3 else [1.0, None, None])
        for i, row in enumerate(results.tables[4])
    ]
    text = section(reproduction_page(only(with_table(results, 4, rows), "tables.4")), "Table 4").text
    assert text.startswith("Half of the starts or more reach the paper's mean error in 0 of 4 rows with trainlm")
    assert "and in 3 of 4 rows with varpro;" in text


def test_the_speedup_of_varpro_is_the_median_of_rows(results):
    rows = [
        with_times(row, trainlm=t, varpro=1.0) for row, t in zip(results.tables[2][:3], (2.0, 3.0, 10.0), strict=True)
    ]
    page = reproduction_page(only(with_table(results, 2, rows), "tables.2"))
    text = section(page, "In short").text
    assert "In 3 rows both reach it" in text
    assert "trainlm then takes 3 times as long as varpro in the median (from 2 to 10)" in text
    assert "Table 3 is not part of this run" in page.sections[-1].text
    assert [row.value for row in page.summary if row.unit == "times"] == [3.0]


def test_verdicts_are_counted_by_table(results):
    three, four = list(results.tables[3]), list(results.tables[4])
    three[0] = replace(three[0], verdict=three[0].verdict | {"trainlm": "not reached"})
    four[0] = replace(four[0], verdict=four[0].verdict | {"trainlm": "stopped by the time limit"})
    four[3] = replace(four[3], verdict=dict.fromkeys(("trainlm", "varpro"), "used to fit the box"))
    page = reproduction_page(only(with_table(with_table(results, 3, three), 4, four), "tables.3", "tables.4"))
    table = section(page, "In short").tables[0]
    where = heads(table).index(("trainlm, rows", "not reached"))
    assert [line[where] for line in table.rows] == [1, 0]
    assert page.summary[0].value == "13 of 14"  # of 16, one was cut short and one was used to fit the box
    assert page.summary[1].value == "13 of 13"  # two rows have no varpro


def test_a_training_that_rows_share_counts_once(results):
    rows = [with_times(row, trainlm=1.0, varpro=1.0) for row in results.tables[2]]
    rows[0] = replace(rows[0], verdict=rows[0].verdict | {"trainlm": "used to fit the box"})
    page = reproduction_page(only(with_table(results, 2, rows), "tables.2"))
    assert page.summary[0].value == "10 of 10"  # 17 rows without 6 to 11 and the first
    assert page.summary[1].value == "11 of 11"
    text = words(section(page, "Table 2").text)
    assert "in 10 of 10 rows with trainlm and in 11 of 11 rows with varpro; rows that were used to fit the box" in text
    assert "In 11 rows both reach it" in section(page, "In short").text


def test_gradient_descent_has_no_time_to_the_papers_error(results):
    rows = [with_times(row, trainlm=1.0) for row in results.tables[3]]
    part = section(reproduction_page(only(with_table(results, 3, rows), "tables.3")), "Table 3")
    where = heads(part.tables[1]).index(("time to the paper's mean error", "trainlm"))
    assert [line[where] for line in part.tables[1].rows] == [1.0] * 10 + [None] * 2
    assert "in 10 of 10 rows with trainlm" in part.text


def test_the_learning_rate_has_no_effect(page):
    text = words(section(page, "The learning rate").text)
    assert text.startswith("The learning rate has no effect")
    assert "trainlm has no learning rate. The paper's rows 1, 8 and 9, with the rates 0.01, 0.1, 1" in text
    assert "its mean error is 8.61 mm, the median of its starts; the paper's values range from 8.16 mm to 8.74" in text


def test_the_spread_of_starts_is_compared_with_that_of_the_papers_values(results):
    results = with_claim(
        results,
        "scatter",
        mean_mm=(8.0, 9.0, 10.0),
        mean_many_mm=(8.5, 9.0, 9.5),
        relative_spread=2 / 9,
        paper_rows=(6, 7),
        paper_rows_mean_mm=(10.0, 11.0),
        paper_relative_spread=1 / 10.5,
    )
    text = words(section(reproduction_page(only(results, "claims.scatter")), "The scatter of starts").text)
    assert "spread the mean error by 22.2 % of the median, from 8 mm to 10 mm" in text
    assert "from 10 mm to 11 mm, spread by 9.50 %" in text
    assert "On 2000 poses the same starts range from 8.50 mm to 9.50 mm" in text


def test_the_remaining_ratios_of_the_rows_that_fit_the_box_are_stated(results):
    rows = [
        replace(
            row, verdict={"trainlm": "used to fit the box", "varpro": None}, ratio={"trainlm": ratio, "varpro": 1.0}
        )
        for row, ratio in zip(results.tables[2], (2.0, 0.5, 8.0), strict=False)
    ]
    text = words(section(reproduction_page(only(with_table(results, 2, rows), "tables.2")), "The joint ranges").text)
    # The cube root of 2 x 0.5 x 8.
    assert "the 3 rows of Table 2 that were used to fit the box have, with trainlm, 0.500 to 8 times" in text
    assert "2 times in the geometric mean" in text


def test_boxes_that_give_the_papers_values_and_errors_in_neighbouring_boxes_are_stated(results):
    results = with_claim(
        results,
        "boxes",
        half_width_deg=(20.0, 40.0, 60.0),
        mean_mm={1: (1.0, 4.0, 16.0), 15: (1.0, 1.1, 1.2)},
        paper_mean_mm={1: 8.0, 15: 5.0},
    )
    results = only(results, "claims.boxes", boxes=replace(results.boxes, simulation_deg=55.0))
    text = words(section(reproduction_page(results), "The joint ranges").text)
    # The error doubles every 10 deg: 8 mm is half way from 40 to 60 deg, and 5 deg are a factor of the root of 2.
    assert "8 mm, in a box of \u00b150 deg." in text
    assert re.search("The error is 8(.00)? mm at \u00b150 deg, 11.3 mm at \u00b155 deg, 16(.0)? mm at \u00b160", text)
    assert "Row 15 of Table 2 has the paper's mean error, 5 mm, in none of the boxes tried." in text


def test_the_distance_at_which_varpro_is_worse_than_no_compensation_is_stated(results):
    medians = {"varpro": (0.01, 0.1, 10.0), "nominal": (1.0, 1.0, 1.0), "kinematic": (0.01, 0.01, 0.02)}
    distances = {"distance_deg": (0.0, 10.0, 20.0), "varpro_p95_mm": (0.1, 1.0, 100.0)}
    worse = with_claim(results, "outside", median_mm=medians, **distances)
    text = words(section(reproduction_page(only(worse, "claims.outside")), "Outside the box").text)
    assert "farthest joint 0 deg and 20 deg outside the box: varpro 0.0100 mm and 10 mm" in text
    assert "From 15 deg on the error of varpro exceeds that of the nominal arm." in text
    better = with_claim(results, "outside", median_mm=medians | {"nominal": (50.0,) * 3}, **distances)
    text = words(section(reproduction_page(only(better, "claims.outside")), "Outside the box").text)
    assert "the nominal arm without compensation 50 mm and 50 mm" in text
    assert "From" not in text


def with_final_errors(results, errors, floor):
    runs = []
    for run in results.final_test.runs:
        changed = {name: replace(run.errors[name], mean_mm=mean) for name, mean in errors.items()}
        runs.append(replace(run, errors=run.errors | changed, noise_floor_mm=floor))
    return replace(results, final_test=replace(results.final_test, runs=tuple(runs)))


def test_a_share_is_stated_with_the_remaining_error_and_the_floor(results):
    results = with_final_errors(results, {"nominal": 1.0, "varpro": 0.03}, 0.02)
    text = words(section(reproduction_page(only(results, "final_test")), "What 97\u202f% means").text)
    assert "With varpro, 97 % of a mean error of 1 mm is removed; 0.0300 mm remains" in text
    assert "more than 98 % could not be removed, and the error of varpro is 1.50 times that floor" in text
    assert "0.100 mm, the same remaining 0.0300 mm would be 70 % removed" in text


def test_without_varpro_the_meaning_of_a_share_is_missing(results):
    runs = [
        replace(run, errors={k: e for k, e in run.errors.items() if k != "varpro"}) for run in results.final_test.runs
    ]
    without = replace(results, final_test=replace(results.final_test, runs=tuple(runs)))
    text = reproduction_page(only(without, "final_test")).sections[-1].text
    assert "The meaning of a removed share is not part of this run" in text


# Odd numbers and texts -----------------------------------------------------------------------------------------------


def test_texts_of_the_results_are_text_and_not_markup(results):
    rows = [
        replace(row, verdict=dict.fromkeys(row.verdict, HOSTILE), note=HOSTILE, activation=HOSTILE)
        for row in results.tables[4]
    ]
    results = with_claim(with_table(results, 4, rows), "scatter", what=HOSTILE)
    changed = {"truearm": HOSTILE, "skipped": [HOSTILE], "rule": HOSTILE, "trained": (HOSTILE, HOSTILE)}
    html = render(reproduction_page(only(results, "tables.4", "claims.scatter", **changed)))
    assert "script" not in Outline(html).tags
    assert html.count("&lt;script&gt;") > 10


def test_numbers_far_apart_are_drawn(results):
    random = np.random.default_rng(2)
    rows = []
    for row in results.tables[4]:
        trainlm = row.results["trainlm"]
        runs = [replace(one, mean_many_mm=float(10 ** random.uniform(-11, 11))) for one in trainlm.runs]
        new = TrainerResult.of("trainlm", runs, time_limit_s=None)
        paper = replace(row.paper, mean_mm=1e-11, seconds=0.0)
        rows.append(with_times(replace(row, paper=paper, results=row.results | {"trainlm": new}), trainlm=0.0))
    results = with_claim(with_table(results, 4, rows), "scatter", mean_mm=(1.0,) * 30)
    page = reproduction_page(only(results, "tables.4", "claims.scatter"))
    assert Outline(render(page)).tags.count("figure") == 3
