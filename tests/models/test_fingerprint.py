"""Fingerprints of data: all that identification learns from is in them, and nothing else."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from truearm.models import KinematicModel
from truearm.models.model_file import load_model
from truearm.models.training_conditions import fingerprint
from truearm.readings import Lengths, Session, read_session, write_session

N = 6


def whole():
    rng = np.random.default_rng(0)
    quaternion = rng.normal(size=(N, 4))
    names = np.array(list("abcabc"))
    points = rng.normal(size=(N, 3))
    points[1] = np.nan
    return Session(
        rng.normal(size=(N, 2)),
        points,
        point_std=np.where(np.isnan(points), np.nan, 0.01),
        seat=names,
        position=names,
        session=names,
        temperature_degC=rng.uniform(15, 25, N),
        quaternion=quaternion / np.linalg.norm(quaternion, axis=1)[:, None],
        sphere=names,
        plane=names,
        line=names,
        directions=np.ones((N, 2)),
        columns={"load_1_Nm": rng.normal(size=N)},
    )


@pytest.mark.parametrize(
    "name",
    [f.name for f in fields(Session) if isinstance(getattr(whole(), f.name), np.ndarray) and f.name != "numbers"],
)
def test_every_column_counts(name):
    readings = whole()
    turned = getattr(readings, name)[::-1]
    if name == "directions":
        turned = -turned
    changes = {name: turned}
    if name == "points":
        changes["point_std"] = readings.point_std[::-1]
    if name == "point_std":
        changes = {name: 2 * turned[::-1]}
    assert fingerprint(replace(readings, **changes)) != fingerprint(readings)
    if name not in ("angles", "points"):
        assert fingerprint(replace(readings, **{name: None})) != fingerprint(readings)


def test_loads_count_with_their_names():
    readings = whole()
    values = readings.columns["load_1_Nm"]
    others = [{}, {"load_2_Nm": values}, {"load_1_Nm": values[::-1]}]
    prints = {fingerprint(replace(readings, columns=columns)) for columns in (*others, readings.columns)}
    assert len(prints) == 4


def test_names_do_not_run_into_each_other():
    angles = np.zeros((2, 1))
    one, other = (Session(angles, seat=np.array(seats)) for seats in (["ab", "c"], ["a", "bc"]))
    assert fingerprint(one) != fingerprint(other)
    assert fingerprint(one) != fingerprint(Session(angles, sphere=np.array(["ab", "c"])))


def test_the_file_and_the_way_through_it_do_not_count(tmp_path):
    readings = whole()
    write_session(readings, tmp_path / "s.csv", angle_unit="rad")
    assert fingerprint(read_session(tmp_path / "s.csv")) == fingerprint(readings)
    assert fingerprint(replace(readings, file=Path("x"), numbers=readings.numbers + 6, by_line=True)) == fingerprint(
        readings
    )
    angles = readings.angles.copy()
    angles[0, 0] = 0.0
    zero, negative = replace(readings, angles=angles), replace(readings, angles=angles * [-1, 1])
    assert fingerprint(replace(negative, angles=negative.angles * [-1, 1])) == fingerprint(zero)


def test_lengths_have_a_fingerprint_of_their_own(real, rng, tmp_path):
    readings, lengths = real.held(rng), real.lengths()
    model = KinematicModel(real.arm).fit_readings(readings, lengths=lengths)
    other = Lengths(lengths.seat_a, lengths.seat_b, lengths.length_mm + 0.001, lengths.u_mm)
    assert model.lengths_fingerprint_ == fingerprint(lengths) != fingerprint(other)
    assert model.data_fingerprint_ == fingerprint(readings)
    model.save(tmp_path / "m")
    assert load_model(tmp_path / "m").lengths_fingerprint_ == model.lengths_fingerprint_
    assert KinematicModel(real.arm).fit_readings(readings).lengths_fingerprint_ == ""
