"""Two units of one type are two arms: their readings, models and histories do not mix, and both numbers are named."""

from dataclasses import replace
from functools import cache
from hashlib import sha256

import numpy as np
import pytest

import truearm
import truearm as ta
from refusals import refuses
from truearm.arm import load_arm, read_arm, write_arm
from truearm.errors import InputError
from truearm.readings import read_session, write_session
from truearm.wings.laboratory.standards.coordinate_origin import CoordinateOrigin
from truearm.wings.reports.arms import describe_arm


@cache
def readings(unit: int, *, seed: int = 1) -> ta.Session:
    return ta.simulate(
        "measuring7", poses=20, strategy="seat", seats=4, preset="shop", seed=seed, arm_seed=unit
    ).session


@pytest.fixture(scope="module")
def of_one() -> ta.Session:
    return readings(1)


@pytest.fixture(scope="module")
def model(of_one):
    return ta.fit("measuring7", of_one, model="nominal").model


def test_a_virtual_arm_has_a_number_of_preset_and_seed(of_one, tmp_path):
    assert set(of_one.serial_number) == {"virtual-shop-1"}
    write_session(of_one, tmp_path / "readings.csv")
    assert set(read_session(tmp_path / "readings.csv").serial_number) == {"virtual-shop-1"}


def test_a_virtual_arm_of_a_unit_keeps_its_number():
    unit = replace(load_arm("gao2017"), serial_number="10017")
    session = ta.simulate(unit, poses=10, preset="shop").session
    assert set(session.serial_number) == {"10017"}


def test_a_model_keeps_the_number_of_its_readings(model, tmp_path):
    assert model.arm_.serial_number == "virtual-shop-1"
    model.save(tmp_path / "m.truearm")
    assert ta.load_model(tmp_path / "m.truearm").arm_.serial_number == "virtual-shop-1"


def test_readings_of_another_unit_are_refused_with_both_numbers(model):
    says = "readings are of the arm with serial number 'virtual-shop-2', arm 'measuring7' has 'virtual-shop-1'"
    refuses(says, ta.evaluate, model, readings(2))


def test_a_fit_refuses_an_arm_file_of_another_unit(of_one, tmp_path):
    write_arm(replace(load_arm("measuring7"), serial_number="10018"), tmp_path / "arm.toml")
    assert read_arm(tmp_path / "arm.toml").serial_number == "10018"
    refuses(r"'virtual-shop-1'.*'10018'", ta.fit, tmp_path / "arm.toml", of_one, model="nominal")


def test_readings_without_a_number_are_of_any_unit(model, of_one):
    bare = replace(of_one, serial_number=None)
    assert len(ta.predict(model, bare).points) == 20
    assert ta.fit("measuring7", bare, model="nominal").model.arm_.serial_number == ""


def test_a_session_of_two_units_is_refused(of_one):
    names = np.where(np.arange(20) < 12, "a", "b")
    with pytest.raises(InputError, match="expected readings of one arm, got serial numbers 'a' and 'b'") as refused:
        ta.fit("measuring7", replace(of_one, serial_number=names), model="nominal")
    assert refused.value.row == "reading 13"


def test_the_points_of_a_verification_state_the_unit_of_the_model(tmp_path):
    plan = ta.load_verification_plan("asme-b89.4.22")
    sheet = ta.operator_sheet(plan.model_copy(update={"single_point": None, "volumetric": None}))
    sheet.save_points(tmp_path / "points.csv", tip_diameter_mm=6)
    artefacts = sheet.sheet.artefacts
    angles = ta.rehearse("measuring7", tmp_path / "points.csv", artefacts=artefacts, preset="shop", arm_seed=1).session
    bare = replace(angles, serial_number=None)
    model = ta.fit("measuring7", readings(1), model="nominal").model
    (tmp_path / "again.csv").write_bytes((tmp_path / "points.csv").read_bytes())
    ta.fill_points(ta.predict(model, bare), tmp_path / "points.csv", artefact_degC=20)
    measured = ta.read_points(tmp_path / "points.csv")
    assert measured.serial_number == "virtual-shop-1"
    model.save(tmp_path / "m.truearm")  # the same model gives the same file
    digest = sha256((tmp_path / "m.truearm").read_bytes()).hexdigest()
    outside = ta.predict(model, bare).outside_training
    assert measured.origin == CoordinateOrigin(
        f"truearm {truearm.__version__}", "nominal", digest, int(outside.sum()), len(outside)
    )
    form_of_file = tmp_path / "of-file.csv"
    form_of_file.write_bytes((tmp_path / "again.csv").read_bytes())
    ta.fill_points(ta.predict(tmp_path / "m.truearm", bare), form_of_file, artefact_degC=20)
    origin = ta.read_points(form_of_file).origin
    assert (origin.model, origin.model_sha256) == ("m.truearm (nominal)", digest)
    form = (tmp_path / "again.csv").read_text().splitlines()
    at = form[0].split(",").index("serial_number")
    first = form[1].split(",")
    first[at] = "virtual-shop-2"
    (tmp_path / "again.csv").write_text("\n".join([form[0], ",".join(first), *form[2:]]) + "\n")
    with pytest.raises(InputError, match=r"line 2.*'virtual-shop-2', the model is of 'virtual-shop-1'"):
        ta.fill_points(ta.predict(model, bare), tmp_path / "again.csv", artefact_degC=20)


def test_the_description_of_an_arm_names_its_unit():
    unit = replace(load_arm("measuring7"), serial_number="10017")
    assert "serial number: 10017" in str(describe_arm(unit)).splitlines()
    assert describe_arm(unit).to_dict()["serial_number"] == "10017"
    assert "serial number" not in str(describe_arm("measuring7"))


def test_a_history_is_of_one_unit(model, tmp_path):
    ta.check(model, readings(1, seed=2), tmp_path / "history.sqlite")
    before = (tmp_path / "history.sqlite").read_bytes()
    other = ta.fit("measuring7", readings(2), model="nominal").model
    says = "history are of serial number 'virtual-shop-1', the model is of 'virtual-shop-2'"
    refuses(says, ta.check, other, readings(2, seed=2), tmp_path / "history.sqlite")
    assert (tmp_path / "history.sqlite").read_bytes() == before
