"""A folder and the file of the same readings: the same readings count, under the same conditions, in the same words."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import truearm as ta
from refusals import refuses
from truearm.errors import InputError
from truearm.readings import large_sessions
from truearm.readings.large_sessions import joined_sessions

WHY = "the limits of the drawing are older"


@pytest.fixture(scope="module")
def session():
    return ta.simulate("ur10", poses=240, seed=1).session


@pytest.fixture(scope="module")
def model(session):
    return ta.fit("ur10", session.rows(np.arange(120)), model="kinematic").model


def saved(path, *files):
    """A folder of these sessions, in their order."""
    path.mkdir()
    for number, one in enumerate(files):
        one.save(path / f"{number:02}.csv")
    return path


def test_readings_of_the_training_are_skipped_over_all_files(session, model, tmp_path):
    trained, others = session.rows(np.arange(120)), session.rows(np.arange(120, 200))
    mixed = joined_sessions([session.rows(np.arange(60, 120)), others])
    for number, files in enumerate([(trained, others), (others, trained), (mixed, trained), (trained,)]):
        folder, whole = saved(tmp_path / str(number), *files), joined_sessions(files)
        (tmp_path / f"{number}.csv").unlink(missing_ok=True)
        parts, one = ta.evaluate(model, folder), ta.evaluate(model, whole)
        assert parts.errors["model"]["n"] == one.errors["model"]["n"] == (80 if number < 3 else 120)
        assert parts.n_training == one.n_training
        # The sums are added in another order.
        assert parts.errors["model"]["mean_mm"] == pytest.approx(one.errors["model"]["mean_mm"], rel=1e-9)
        assert (parts.coverage, parts.coverage_99) == (one.coverage, one.coverage_99)
        words = "training readings of the model"
        assert [one for one in parts.remarks if words in one] == [one for one in one.remarks if words in one]
        assert "have no reference point" not in str(parts)


def beyond(session, n):
    """The readings, the first `n` of them beyond the limit of a joint."""
    angles = session.angles.copy()
    angles[:n, 0] = 7.0
    return replace(session, angles=angles)


@pytest.mark.parametrize("processes", [0, 2])
def test_what_was_accepted_in_a_file_is_kept(session, model, two_processes, tmp_path, processes):
    executor = two_processes if processes else None
    files = [beyond(session.rows(np.arange(10 * i, 10 * i + 10)), n) for i, n in enumerate((0, 8, 9, 8))]
    folder, out = saved(tmp_path / "set", *files), tmp_path / "z.csv"
    refuses("--accept", ta.predict, model, folder, out)
    found = ta.predict(model, folder, out, accept=WHY, executor=executor)
    said = {one for file in folder.iterdir() if file.stem != "00" for one in overridden_in(model, file)}
    assert [one.reason for one in found.accepted] == [WHY]
    assert len(found.accepted[0].contradictions) == len(said)
    assert set(found.accepted[0].contradictions) == said
    assert [one for one in found.remarks if WHY in one] == [str(found.accepted[0])]
    assert not any("Nothing had to be accepted" in one for one in found.remarks)
    evaluation = ta.evaluate(model, folder, accept=WHY, executor=executor)
    assert len([one for one in evaluation.remarks if "ccepted" in one]) == 1
    honest = ta.predict(model, folder / "00.csv", accept=WHY)
    assert honest.accepted == ()
    assert "Nothing had to be accepted." in honest.remarks


def overridden_in(model, file):
    return [text for one in ta.predict(model, file, accept=WHY).accepted for text in one.contradictions]


def test_remarks_of_later_files_are_counted(session, model, tmp_path):
    files = [beyond(session.rows(np.arange(120 + 12 * i, 132 + 12 * i)), i + 1) for i in range(5)]
    few = ta.evaluate(model, saved(tmp_path / "few", *files)).remarks
    assert len([one for one in few if "beyond a joint limit" in one]) == 5
    assert not any("other remarks" in one for one in few)
    files = [beyond(session.rows(np.arange(120 + 10 * i, 130 + 10 * i)), i % 5 + 1) for i in range(10)]
    files[5:] = [joined_sessions([one, session.rows(np.arange(200, 203))]) for one in files[5:]]
    many = ta.evaluate(model, saved(tmp_path / "many", *files)).remarks
    assert len([one for one in many if "beyond a joint limit" in one]) == 6
    assert "And 4 other remarks on joint limits in other parts of the session." in many
    predicted = ta.predict(model, tmp_path / "many", tmp_path / "z.csv").remarks
    assert any("other remarks" in one for one in predicted)


@pytest.fixture(scope="module")
def physical(session):
    """Trained on one named day."""
    trained = replace(session.rows(np.arange(120)), session=np.full(120, "monday"))
    return ta.fit("ur10", trained, model="physical", highest=4).model


NAMES = {
    "same day": (("monday", "monday"), "repeatability"),
    "another day": (("tuesday", "tuesday"), "reproducibility"),
    "both": (("monday", "tuesday"), "reproducibility"),
    "half of them named": (("monday", ""), None),
    "unnamed": (("", ""), None),
}


@pytest.mark.parametrize(("names", "conditions"), NAMES.values(), ids=NAMES)
def test_conditions_and_coverage_are_those_of_one_file(session, physical, tmp_path, names, conditions):
    files = [
        replace(session.rows(np.arange(a, a + 50)), session=np.full(50, name))
        for a, name in zip((120, 170), names, strict=True)
    ]
    parts, one = (ta.evaluate(physical, one) for one in (saved(tmp_path / "set", *files), joined_sessions(files)))
    assert parts.conditions == one.conditions == conditions
    same = ("coverage", "coverage_99", "repeatability_coverage", "conditions")
    assert {name: parts.to_dict()[name] for name in same} == {name: one.to_dict()[name] for name in same}
    assert one.repeatability_coverage is not None
    said = "ellipsoid of repeatability conditions"
    assert [line for line in str(parts).splitlines() if said in line] == [
        line for line in str(one).splitlines() if said in line
    ]
    assert ta.evaluate(physical, tmp_path / "set", conditions="repeatability").conditions == "repeatability"


@pytest.mark.parametrize("n", [2, 4, 100])
def test_the_median_uncertainty_is_that_of_one_file(session, model, tmp_path, n):
    some = session.rows(np.arange(120, 120 + n))
    folder = saved(tmp_path / "set", some.rows(np.arange(n // 2)), some.rows(np.arange(n // 2, n)))
    parts, one = ta.predict(model, folder, tmp_path / "z.csv"), ta.predict(model, some)
    assert parts.median_u_mm == pytest.approx(one.median_u_mm, rel=1.01e-3)  # the table is wide by 0.1 %
    assert np.array_equal(parts.sums.u.counts, one.sums.u.counts)
    assert np.array_equal(parts.sums.u_outside.counts, one.sums.u_outside.counts)
    assert one.sums.u.counts.sum() == 3 * n


def test_zeros_say_from_how_many_readings_they_are(session, tmp_path, monkeypatch):
    monkeypatch.setattr(large_sessions, "SAMPLE", 100)
    found = ta.fit("ur10", saved(tmp_path / "set", session), model="kinematic")
    assert found.arm_with_zeros().source.endswith("joint zeros identified from 240 readings")
    assert found.of_sample.arm_with_zeros().source.endswith("joint zeros identified from 100 readings")


def test_of_many_outliers_the_largest_are_kept_and_it_says_so(session, model, tmp_path):
    points = session.points.copy()
    points[150:200] += 5.0
    wrong = replace(session, points=points)
    few, many = (saved(tmp_path / name, wrong.rows(np.arange(120, n))) for name, n in (("few", 160), ("many", 200)))
    said = str(ta.evaluate(model, many))
    assert "outlier: 14 more readings (--json or to_dict() lists the 20 largest of 50)" in said
    assert len(ta.evaluate(model, many).to_dict()["outliers"]) == 20
    assert "outlier: 4 more readings (--json or to_dict() lists all)" in str(ta.evaluate(model, few))


def test_lengths_without_their_seats_in_the_sample_are_refused(session, tmp_path, monkeypatch):
    seats = np.full(240, "")
    seats[::6], seats[3::6], seats[[100, 200]] = "A", "B", "C"
    folder = saved(tmp_path / "set", replace(session, seat=seats))
    lengths = ta.Lengths(np.array(["A", "A"]), np.array(["B", "C"]), np.array([500.0, 700.0]), np.array([0.5, 0.5]))
    monkeypatch.setattr(large_sessions, "SAMPLE", 80)
    said = "1 of 2 lengths are between seats that are not in the sample of 80 of 240 readings"
    refuses(said, ta.fit, "ur10", folder, model="nominal", lengths=lengths, accept=WHY)


def test_a_regressor_is_told_that_it_is_evaluated_on_one_file(session, tmp_path):
    class Constant:
        def predict(self, angles):
            return np.zeros((len(angles), 3))

    with pytest.raises(InputError, match="a regressor is evaluated on one file, got a folder"):
        ta.evaluate(Constant(), saved(tmp_path / "set", session))


def test_files_of_two_arms_are_refused_as_one_file_of_both_is(session, model, tmp_path):
    """Of a model that states no serial number; nothing is written."""
    named = [replace(session.rows(np.arange(n, n + 60)), serial_number=np.full(60, f"arm {n}")) for n in (120, 180)]
    bare = replace(session.rows(np.arange(120)), serial_number=None)
    anonymous = ta.fit("ur10", bare, model="nominal").model
    assert anonymous.arm_.serial_number == ""
    folder, out = saved(tmp_path / "two", *named), tmp_path / "points.csv"
    evaluate, predict = partial(ta.evaluate, anonymous, folder), partial(ta.predict, anonymous, folder, out)
    for verb in (evaluate, predict):
        refuses("expected readings of one arm, got serial numbers 'arm 120' and 'arm 180'", verb)
        assert not out.exists()
        assert len(verb(accept=WHY).findings) > 0
    one = ta.predict(anonymous, saved(tmp_path / "one", named[0]), tmp_path / "one.csv")
    assert one.serial_number == "arm 120"


def test_points_in_another_unit_are_doubted_in_a_folder_too(session, model, tmp_path):
    small = replace(session, points=session.points / 1e3).rows(np.arange(120, 240))
    folder = saved(tmp_path / "small", small)
    said = "The nominal arm misses these points by"
    assert [one[:70] for one in ta.evaluate(model, folder).remarks if said in one] == [
        one[:70] for one in ta.evaluate(model, small).remarks if said in one
    ]
    assert said in str(ta.evaluate(model, folder))
