"""``truearm reproduce``: its files, its output, its refusals."""

import json
import math
from dataclasses import replace

import pytest

from truearm.models import NetworkModel, NominalModel
from truearm.readings.files import write_session
from truearm.wings.gao2017 import training_plan
from truearm.wings.gao2017.reproduce import reproduce
from truearm.wings.gao2017.tables import TABLES
from truearm.wings.planning.simulate import simulate

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def small(monkeypatch):
    """One row a table, a few poses, units and epochs."""
    for table, rows in list(TABLES.items()):
        row = rows[-1]
        monkeypatch.setitem(TABLES, table, (replace(row, n_train=150, hidden=(4,) * len(row.hidden), mean_mm=150.0),))
    effort = replace(
        training_plan.FULL_EFFORT, epochs=5, varpro_epochs={2: 3, 3: 3, 4: 3}, starts=((math.inf, 1),), starts_by_row={}
    )
    monkeypatch.setattr(training_plan, "FULL_EFFORT", effort)
    monkeypatch.setattr("truearm.wings.gao2017.reproduction.N_OUTSIDE", 20)
    # Their fits take seconds, and what they do is tested elsewhere.
    for model in ("HybridModel", "PhysicalModel"):
        monkeypatch.setattr(f"truearm.wings.gao2017.reproduction.{model}", NominalModel)
    monkeypatch.setattr(training_plan, "QUICK_EFFORT", replace(effort, quick=True, starts=((1e-9, 1),)))


def test_a_table_is_printed_and_written_with_its_page(truearm, small, tmp_path):
    ran = truearm("reproduce", "gao2017", "--table", 3, "--out", tmp_path / "new" / "g").done()
    folder = tmp_path / "new" / "g"
    assert sorted(path.name for path in folder.iterdir()) == ["runs", "table-3.html", "table-3.json"]
    assert len(list((folder / "runs").iterdir())) == 2
    found = json.loads((folder / "table-3.json").read_text())
    (row,) = found["tables"]["3"]
    lines = ran.out.splitlines()
    assert lines.pop(0) == "2 trainings: 1 not reached, 1 better"
    assert lines.pop(0).startswith("trainlm fits 70 % of the poses")
    assert lines[0].startswith("Table 3, simulation 2")
    assert lines[1].split()[:4] == ["row", "network", "by", "mean"]
    assert lines[2].split() == ["12", "4-4", "paper", "150", "119", "3.0"]
    for line, method in ((lines[3], "trainlm"), (lines[4], "varpro")):
        result = row["results"][method]
        assert line.split()[0] == result["trainer"]
        assert line.split()[1] == f"{result['median']['mean_many_mm']:.4g}"
        assert line.endswith(row["verdict"][method])
    assert "table-3.html" in lines[-1]
    assert "Table 3" in (folder / "table-3.html").read_text()


def test_a_second_run_prints_the_same_and_trains_nothing(truearm, small, tmp_path, monkeypatch):
    arguments = ["reproduce", "gao2017", "--table", 4, "--out", tmp_path]
    first = truearm(*arguments)
    monkeypatch.setattr("truearm.wings.gao2017.training._train", None)  # called, it would fail
    assert truearm(*arguments) == first
    said = first.out
    assert "Final test: 200 further poses" in said
    assert said.count("kinematic") == 1


def test_what_the_time_limit_cuts_is_marked_until_a_run_without_it(truearm, small, tmp_path):
    arguments = ["reproduce", "gao2017", "--table", 4, "--out", tmp_path]
    cut = truearm(*arguments, "--time-limit", "1e-9").out
    assert "The time limit ended 2 starts before a stop of their own" in cut
    assert cut.count("(cut)") == 1 + 2 + 2  # the sentence, both trainers in Table 4 and in the final test
    page = (tmp_path / "table-4.html").read_text()
    assert "starts cut by our time limit" in page
    assert "error removed on 200 further poses, trainlm (cut)" in page
    whole = str(reproduce("gao2017", table=4, folder=tmp_path, time_limit=math.inf))
    assert "(cut)" not in whole
    assert "ended" not in whole


def test_json_is_what_the_file_holds(truearm, small, tmp_path):
    ran = truearm("reproduce", "gao2017", "--table", 3, "--quick", "--out", tmp_path, "--json").done()
    found = json.loads(ran.out)
    assert found == json.loads((tmp_path / "table-3.json").read_text())
    assert found["quick"]
    assert len(found["skipped"]) == 2


def test_a_quick_run_says_of_how_many_rows(truearm, small, tmp_path, monkeypatch):
    table, (row,) = 2, TABLES[2]
    monkeypatch.setitem(TABLES, table, (replace(row, row=1), replace(row, row=2, hidden=(40, 40))))
    slow = training_plan.training_of(table, TABLES[table][1], "trainlm", training_plan.QUICK_EFFORT, seed=0)
    limit = slow.estimated_seconds / 3
    effort = replace(training_plan.QUICK_EFFORT, starts=((limit, 1),))
    monkeypatch.setattr(training_plan, "QUICK_EFFORT", effort)
    ran = truearm("reproduce", "gao2017", "--table", table, "--quick", "--out", tmp_path)
    assert "trainlm ran 1 of 2 rows, without Table 2 row 2." in ran.out.splitlines()[1]
    assert "without" not in truearm("reproduce", "gao2017", "--table", table, "--out", tmp_path).out


@pytest.mark.parametrize("number", [1, 6])
def test_a_figure_is_drawn(truearm, tmp_path, number):
    ran = truearm("reproduce", "gao2017", "--figure", number, "--out", tmp_path).done()
    assert (tmp_path / f"figure-{number}.png").read_bytes().startswith(b"\x89PNG")
    assert f"figure-{number}.png" in ran.out
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [*(f"figure-{number}.{kind}" for kind in ("html", "json", "png")), "runs"]
    assert not list((tmp_path / "runs").iterdir())


def test_an_interrupted_reproduction_resumes(truearm, small, tmp_path, monkeypatch):
    from truearm.wings.gao2017 import training as gao2017_training

    calls, train = [], gao2017_training._train

    def stop_at_the_second(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return train(*arguments)

    monkeypatch.setattr(gao2017_training, "_train", stop_at_the_second)
    arguments = ["reproduce", "gao2017", "--table", 3, "--out", tmp_path]
    ran = truearm(*arguments)
    assert (ran.code, ran.out) == (130, "")
    assert ran.err.splitlines() == [
        f"truearm: finished trainings are in {tmp_path / 'runs'}; the same command resumes with the next one",
        "truearm: interrupted",
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs"]
    ran = truearm(*arguments).done()
    assert len(calls) == 2 + 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "expected what to reproduce"),
        (["--table", 1], "expected a table among 2, 3, 4, got 1"),
        (["--figure", 5], "expected a figure among 1, 2, 3, 4, 6, 7, 8, got 5"),
        (["--figure", 9], "got 9"),
        (["--table", 2, "--all"], "expected one of --table, --figure and --all"),
        (["--table", 2, "--figure", 1], "expected one of --table, --figure and --all"),
        (["--table", "two"], "--table"),
        (
            ["--table", 4, "--hidden", "3", "--test-session", "a.csv"],
            "--test-session and --hidden apply to --session only",
        ),
        (["--session", "a.csv", "--table", 4], "--table does not go with --session"),
        (["--session", "a.csv", "--hidden", "3x"], "--hidden expects numbers of units"),
        (["--table", 4, "--time-limit", 0], "expected a time limit above 0 s, got 0.0"),
        (["--table", 4, "--time-limit", "nan"], "expected a time limit above 0 s, got nan"),
    ],
)
def test_what_cannot_be_reproduced_is_refused_in_one_line(refused, tmp_path, snapshot, arguments, said):
    refused(["reproduce", "gao2017", *arguments, "--out", tmp_path / "g"], said)
    assert snapshot(tmp_path) == {}


def test_another_paper_is_not_known(refused, tmp_path):
    refused(["reproduce", "gao2018", "--all", "--out", tmp_path / "g"], "gao2017")


def test_a_file_where_the_folder_should_be_is_refused(truearm, tmp_path):
    (tmp_path / "g").write_text("mine")
    assert "got a file" in truearm("reproduce", "gao2017", "--figure", 3, "--out", tmp_path / "g").refused().err
    assert (tmp_path / "g").read_text() == "mine"


def test_a_damaged_training_is_named_with_the_remedy(truearm, refused, small, tmp_path):
    arguments = ["reproduce", "gao2017", "--table", 3, "--out", tmp_path]
    assert truearm(*arguments).code == 0
    file = sorted((tmp_path / "runs").iterdir())[0]
    file.write_text("{}")
    refused(arguments, str(file), "delete it")


# On readings of one's own --------------------------------------------------------------------------------------------


@pytest.fixture
def own(tmp_path):
    """The command on a few readings, with fresh ones, of an arm that it is not told."""
    session = simulate("gao2017", poses=60, seed=4).session
    for name, rows in {"mine.csv": slice(0, 40), "fresh.csv": slice(40, 60)}.items():
        write_session(session.rows(rows), tmp_path / name)
    files = ["--session", tmp_path / "mine.csv", "--test-session", tmp_path / "fresh.csv", "--out", tmp_path / "own"]
    return ["reproduce", "gao2017", *files, "--hidden", "1", "--hidden", "2", "--folds", 2, "--epochs", 5]


def test_the_procedure_on_own_readings_prints_the_answer_and_writes_a_model(truearm, own, tmp_path):
    ran = truearm(*own).done()
    lines = ran.out.splitlines()
    assert lines[0].startswith("Your network (")
    assert "mean error" in lines[0]
    assert "on 20 fresh readings, 2 sigma" in lines[0]
    assert any(line.startswith("Of 60 coordinates the network errs by more than 0.05 mm in ") for line in lines)
    assert sum(line.split()[-1:] == ["chosen"] for line in lines) == 1
    folder = tmp_path / "own"
    names = {path.name for path in folder.iterdir()}
    assert names == {"runs", "procedure.html", "procedure.json", "network.truearm", "figure-7.png", "figure-8.png"}
    assert truearm("predict", folder / "network.truearm", tmp_path / "fresh.csv", "--out", tmp_path / "p.csv").code == 0
    assert json.loads(truearm(*own, "--json").out) == json.loads((folder / "procedure.json").read_text())


def test_an_interrupted_search_keeps_what_has_finished(truearm, own, tmp_path, monkeypatch):
    calls, fit = [], NetworkModel.fit_readings

    def stop_at_the_third(*arguments, **options):
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return fit(*arguments, **options)

    monkeypatch.setattr(NetworkModel, "fit_readings", stop_at_the_third)
    ran = truearm(*own)
    assert (ran.code, ran.out) == (130, "")
    assert ran.err.splitlines()[0].startswith(f"truearm: finished trainings are in {tmp_path / 'own' / 'runs'}")
    assert [path.name for path in (tmp_path / "own").iterdir()] == ["runs"]
    assert len(list((tmp_path / "own" / "runs").glob("own-*"))) == 2
    assert truearm(*own).code == 0
