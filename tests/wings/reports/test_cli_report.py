"""``truearm report`` of identified arms: sections on what was found, and sessions of seats alone."""

from dataclasses import replace

import pytest

from truearm.wings.reports.report import ReportResult

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def seated(truearm, tmp_path_factory):
    """Readings in three seats and both of a bar at one place, a model of them, and what the bar's length is."""
    folder = tmp_path_factory.mktemp("seated")
    session, lengths, model = (folder / name for name in ("seats.csv", "lengths.csv", "arm.truearm"))
    truearm(
        *("simulate", "gao2017", "--strategy", "seat", "--bars", 1, "--poses", 75, "--no-reference"),
        *("--out-lengths", lengths, "--out", session),
    ).done()
    fitted = truearm("fit", session, "--arm", "gao2017", "--model", "kinematic", "--lengths", lengths, "--out", model)
    assert fitted.code == 0, fitted.err
    return folder


@pytest.fixture
def two_sections(monkeypatch):
    """Pages of two of their sections: to draw them all takes seconds."""
    whole = ReportResult.page
    monkeypatch.setattr(ReportResult, "page", lambda self: replace(page := whole(self), sections=page.sections[:2]))


@pytest.mark.usefixtures("two_sections")
def test_every_figure_of_the_page_is_a_file_of_its_own(truearm, made, tmp_path):
    page, folder = tmp_path / "page.html", tmp_path / "figures"
    ran = truearm("report", made / "kinematic.truearm", made / "test.csv", "--page", page, "--figures", folder).done()
    names = sorted(path.name for path in folder.iterdir())
    text = page.read_text(encoding="utf-8")
    assert len(names) == text.count("<figure") - text.count('class="scene"')
    assert names[0] == "01-error-before-and-after.svg"
    assert all((folder / name).read_bytes().startswith(b"<?xml") for name in names)
    assert str(folder) in ran.out


@pytest.mark.parametrize(("form", "start"), [("pdf", b"%PDF"), ("png", b"\x89PNG")])
@pytest.mark.usefixtures("two_sections")
def test_figures_have_the_form_that_is_asked_for(truearm, made, tmp_path, form, start):
    given = (made / "nominal.truearm", made / "test.csv", "--page", tmp_path / "page.html", "--figures", tmp_path / "f")
    assert truearm("report", *given, "--figures-as", form).code == 0
    files = list((tmp_path / "f").iterdir())
    assert files
    assert all(file.suffix == f".{form}" and file.read_bytes().startswith(start) for file in files)


def test_what_cannot_be_a_folder_of_figures_is_refused_before_the_page_is_drawn(refused, made, tmp_path):
    page, file = tmp_path / "page.html", tmp_path / "file"
    file.write_text("a file")
    given = ("report", made / "kinematic.truearm", made / "test.csv", "--page", page)
    for more, said in (
        (("--figures", file), "the folder cannot be made"),
        (("--figures-as", "pdf"), "--figures-as is for the files of --figures"),
    ):
        refused([*given, *more], said)
        assert not page.exists()


def test_two_identified_arms_are_told_apart(truearm, made, tmp_path):
    page, other = tmp_path / "page.html", tmp_path / "other.truearm"
    other.write_bytes((made / "kinematic.truearm").read_bytes())
    truearm("report", made / "kinematic.truearm", other, made / "train.csv", "--page", page).done()
    text = page.read_text(encoding="utf-8")
    assert ">Uncertainty: kinematic</h2>" in text
    assert ">Uncertainty: other</h2>" in text


def test_a_session_of_seats_has_a_page(truearm, seated, tmp_path):
    page = tmp_path / "page.html"
    ran = truearm(
        "report", seated / "arm.truearm", seated / "seats.csv", "--lengths", seated / "lengths.csv", "--page", page
    ).done()
    assert "1 model compared on 75 readings" in ran.out
    text = page.read_text(encoding="utf-8")
    for said in (
        "Agreement in the seats",
        "B1a",
        ">Lengths</h2>",
        "after a frame was fitted",
        "75 of 75 are training readings of the model",
    ):
        assert said in text, said


def test_a_seat_in_two_sessions_is_refused_by_every_verb(truearm, seated, tmp_path):
    header, *rows = (seated / "seats.csv").read_text(encoding="utf-8").splitlines()
    named = [f"{header},session", *(f"{row},{'May' if i % 2 else 'June'}" for i, row in enumerate(rows))]
    model, session = seated / "arm.truearm", tmp_path / "s.csv"
    session.write_text("\n".join(named), encoding="utf-8")
    for verb, *more in (
        ("fit", session, "--arm", "gao2017", "--out", tmp_path / "m"),
        ("refit", model, session, "--out", tmp_path / "m"),
        ("evaluate", model, session),
        ("report", model, session, "--page", tmp_path / "page.html"),
        ("check", model, session, "--history", tmp_path / "h.sqlite"),
        ("plan", "gao2017", "--artefact", "seat", "--session", session, "--out", tmp_path / "plan.csv"),
    ):
        ran = truearm(verb, *more)
        assert ran.code == 2, (verb, ran.err)
        # What was measured is known, whatever its session is called.
        said = "these are the training readings" if verb == "check" else "reference moved between sessions"
        assert said in ran.err, verb
    assert not list(tmp_path.glob("*.html")) + list(tmp_path.glob("plan*")) + list(tmp_path.glob("m*"))


def test_lengths_are_for_sessions_of_seats(refused, made, seated, tmp_path):
    refused(
        [
            *("report", made / "kinematic.truearm", made / "test.csv"),
            *("--lengths", seated / "lengths.csv", "--page", tmp_path / "page.html"),
        ],
        "lengths are for a session without reference points",
    )
    assert not list(tmp_path.iterdir())


def test_a_session_without_points_or_seats_is_refused(refused, made, tmp_path):
    refused(
        ["report", made / "kinematic.truearm", made / "angles.csv", "--page", tmp_path / "page.html"],
        "reference points, seats or 4 distances to an anchor to compare with",
    )
