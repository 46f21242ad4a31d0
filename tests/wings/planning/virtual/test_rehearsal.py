"""Laws of a rehearsal: a virtual arm carries out a plan, and seats, bars and spheres are where the plan puts them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from refusals import refuses
from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.readings import Lengths
from truearm.wings.laboratory.shapes.least_squares_shapes import fit_sphere
from truearm.wings.planning.designs.candidates import bar_places
from truearm.wings.planning.designs.check_routine import check_routine
from truearm.wings.planning.designs.planned_readings import PlannedReadings, read_planned
from truearm.wings.planning.virtual import VirtualArm
from truearm.wings.planning.virtual.rehearsal import carry_out, move_set_up, touched_points

SEAT_STD_MM = 0.003  # scatter of a tip in a seat of the preset shop


@pytest.fixture(scope="module")
def virtual():
    return VirtualArm.draw(load_arm("gao2017"), "shop", seed=3)


@pytest.fixture(scope="module")
def planned(virtual):
    poses = bar_places(virtual.nominal, 2, length_mm=300, poses=4, seed=0)
    rounded = np.radians(np.round(np.degrees(poses.angles), 1))  # as in the file of a plan
    return PlannedReadings(rounded, poses.seat, None, None, Path("plan.csv"))


def bar(u_mm=0.005, length_mm=300.0):
    ends = [np.array([f"B{place}{end}" for place in (1, 2)]) for end in "ab"]
    return Lengths(*ends, np.full(2, length_mm), np.full(2, u_mm), artefact=np.full(2, "bar"))


def places(measured, planned):
    return {str(name): measured.true_tips[planned.seat == name].mean(axis=0) for name in planned.seat}


def test_all_true_tips_of_a_seat_are_in_it(virtual, planned):
    measured = carry_out(virtual, planned, seed=1)
    for name, place in places(measured, planned).items():
        assert np.abs(measured.true_tips[planned.seat == name] - place).max() < 5 * SEAT_STD_MM
    assert measured.readings.points is None
    assert measured.readings.seat.tolist() == planned.seat.tolist()


def test_the_arm_goes_near_the_planned_poses(virtual, planned):
    measured = carry_out(virtual, planned, seed=1)
    # Aims are rounded by 0.05 deg, some 1.5 mm at the tip; joints that have little effect on the tip turn more.
    assert np.degrees(np.abs(measured.readings.angles - planned.angles)).max() < 1.0


def test_the_bar_has_one_true_length_at_all_places_within_its_certificate(virtual, planned):
    true = []
    for seed in (1, 2):
        at = places(carry_out(virtual, planned, seed=seed, lengths=bar()), planned)
        true += [np.linalg.norm(at[f"B{place}a"] - at[f"B{place}b"]) for place in (1, 2)]
    assert np.ptp(true) < 4 * SEAT_STD_MM  # means of four readings in two seats
    assert abs(np.mean(true) - 300.0) < 5 * 0.005 + 2 * SEAT_STD_MM
    exact = touched_points(virtual.nominal.chain, planned, bar())
    ends = [exact[planned.seat == f"B1{end}"][0] for end in "ab"]
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(300.0, abs=1e-9)


def test_lengths_that_share_a_seat_are_met_together(virtual, planned):
    free = touched_points(virtual.nominal.chain, planned)
    at = {name: free[planned.seat == name][0] for name in planned.seat.tolist()}
    ends = [("B1a", "B1b"), ("B1b", "B2a"), ("B2a", "B2b")]
    stated = np.array([np.linalg.norm(at[a] - at[b]) for a, b in ends]) + [3.0, -2.0, 4.0]
    lengths = Lengths(*np.array(ends).T, stated, np.full(3, 0.005))
    moved = touched_points(virtual.nominal.chain, planned, lengths)
    at = {name: moved[planned.seat == name][0] for name in planned.seat.tolist()}
    assert [np.linalg.norm(at[a] - at[b]) for a, b in ends] == pytest.approx(stated, abs=1e-8)
    assert np.linalg.norm(moved - free, axis=1).max() < 5.0


def test_another_arm_has_another_bar(virtual, planned):
    other = VirtualArm.draw(virtual.nominal, "shop", seed=4)
    wide = bar(u_mm=1.0)
    lengths = []
    for arm in (virtual, other):
        at = places(carry_out(arm, planned, seed=1, lengths=wide), planned)
        lengths.append(np.linalg.norm(at["B1a"] - at["B1b"]))
    assert abs(lengths[0] - lengths[1]) > 0.1


def test_the_tip_stays_on_a_sphere(virtual):
    seats = bar_places(virtual.nominal, 1, length_mm=300, poses=1, seed=0)
    start = virtual.nominal.chain.tip_in_base(seats.angles[:1])
    normals = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    on_ball = start + 15.5 * normals
    perfect = VirtualArm.draw(virtual.nominal, "perfect", seed=0)
    angles = perfect.settle(np.repeat(seats.angles[:1], 5, axis=0), on_ball)
    planned = PlannedReadings(angles, None, np.full(5, "ball"), None, Path("check.csv"))
    measured = carry_out(virtual, planned, seed=1)
    assert fit_sphere(measured.true_tips, std_mm=SEAT_STD_MM).radius_mm == pytest.approx(15.5, abs=5 * SEAT_STD_MM)
    assert measured.readings.sphere.tolist() == ["ball"] * 5
    few = replace(planned, angles=angles[:3], sphere=np.full(3, "ball"))
    refuses("determine no sphere", carry_out, virtual, few, seed=1)


def test_a_planned_sphere_has_its_diameter_however_its_aims_are_rounded(tmp_path):
    arm = load_arm("ur10")
    check_routine(arm, sphere_mm=25.0).save(tmp_path / "check.csv")
    planned = read_planned(tmp_path / "check.csv", arm)
    measured = carry_out(VirtualArm.draw(arm, "research", seed=0), planned, seed=1)
    on_ball = fit_sphere(measured.true_tips[planned.rows_of("ball", "sphere")], std_mm=SEAT_STD_MM)
    assert 2 * on_ball.radius_mm == pytest.approx(31.0, abs=10 * SEAT_STD_MM)  # and a tip of 6 mm


@pytest.mark.parametrize("cell", ["-31", "0", "wide"])
def test_a_planned_diameter_that_is_none_is_refused(tmp_path, cell):
    arm, path = load_arm("ur10"), tmp_path / "check.csv"
    check_routine(arm, sphere_mm=25.0).save(path)
    path.write_text(path.read_text().replace("31.0", cell))
    refuses("note_tip_sphere_mm", read_planned, path, arm)


def test_a_moved_reference_sees_the_same_distances(virtual, planned):
    tracked = replace(planned, seat=None)
    measured = carry_out(virtual, tracked, seed=1)
    moved = move_set_up(measured, seed=1)
    before, after = measured.readings.points, moved.readings.points
    assert np.linalg.norm(after - before, axis=1).min() > 10.0
    assert np.linalg.norm(np.diff(after, axis=0), axis=1) == pytest.approx(
        np.linalg.norm(np.diff(before, axis=0), axis=1), abs=1e-9
    )
    refuses("measured in seats", move_set_up, carry_out(virtual, planned, seed=1), seed=1)


def test_the_plan_of_another_arm_and_lengths_of_another_plan_are_refused(virtual, planned):
    turned = replace(planned, angles=planned.angles + np.radians(20) * np.eye(len(planned), 6))
    refuses("give the arm that the plan was made for", carry_out, virtual, turned, seed=1)
    with pytest.raises(InputError, match=r"mm apart, the file of lengths states 400\.0 mm"):
        carry_out(virtual, planned, seed=1, lengths=bar(length_mm=400.0))
