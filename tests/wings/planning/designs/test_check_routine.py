"""The routine of an interim check: its artefacts keep their places, and its file is one that `check` takes."""

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.readings import read_lengths
from truearm.wings.planning.designs.check_routine import check_routine
from truearm.wings.planning.designs.planned_readings import read_planned


@pytest.fixture(scope="module")
def routine():
    return check_routine(load_arm("gao2017"), length_mm=400, sphere_mm=25)


def tips(routine, name):
    rows = (routine.seat == name) | (routine.sphere == name)
    return routine.arm.chain.tip_in_base(routine.angles[rows])


def test_the_tip_is_in_its_seat_and_the_bar_has_its_length(routine):
    ends = []
    for name, n in (("cone", 10), ("bar A", 4), ("bar B", 4)):
        here = tips(routine, name)
        assert len(here) == n
        assert np.ptp(here, axis=0).max() < 1e-3  # by inverse kinematics
        ends.append(here.mean(axis=0))
    assert np.linalg.norm(ends[1] - ends[2]) == pytest.approx(400.0, abs=1e-3)
    assert min(end[2] for end in ends) >= 0.0  # the table is at the base


def test_the_points_on_the_sphere_spread_over_its_upper_half(routine):
    here = tips(routine, "ball")
    assert len(here) == 9
    centre = here[np.argmax(here[:, 2])] - [0.0, 0.0, 15.5]  # the pole: radius 12.5 mm, tip 3 mm
    assert np.linalg.norm(here - centre, axis=1) == pytest.approx(np.full(9, 15.5), abs=1e-3)
    assert np.linalg.matrix_rank(np.round((here - centre) / 15.5, 3)) == 3


def test_the_file_comes_back_and_the_length_with_it(routine, tmp_path):
    files = routine.save(tmp_path / "check.csv")
    assert [file.name for file in files] == ["check.csv", "check-lengths.csv"]
    planned = read_planned(files[0], routine.arm)
    assert planned.seat.tolist() == routine.seat.tolist()
    assert planned.sphere.tolist() == routine.sphere.tolist()
    assert read_lengths(files[1], seats=["bar A", "bar B"]).length_mm.tolist() == [400.0]
    refuses("the file exists", routine.save, tmp_path / "check.csv")


def test_a_cone_alone_is_a_check(tmp_path):
    alone = check_routine(load_arm("gao2017"))
    assert set(alone.seat.tolist()) == {"cone"}
    assert [file.name for file in alone.save(tmp_path / "check.csv")] == ["check.csv"]


@pytest.mark.parametrize(
    "options", [{"sphere_mm": -25.0}, pytest.param({"sphere_mm": 4000.0}, marks=pytest.mark.weekly), {"length_mm": 1e5}]
)
def test_sizes_that_no_arm_reaches_are_refused(options):
    refuses(None, check_routine, load_arm("gao2017"), **options)
