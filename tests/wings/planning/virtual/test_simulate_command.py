"""``truearm simulate``: sessions of a virtual arm, and no file where the input is wrong."""

import json
from functools import partial

import numpy as np
import pytest

from command_line import called
from refusals import refuses
from truearm.arm.catalogue import load_arm
from truearm.readings import length_errors, read_lengths, read_session
from truearm.wings.planning.virtual import PRESETS, VirtualArm

simulate = partial(called, "simulate")


def test_a_session_file_comes_out_with_what_was_rejected_and_the_floor(tmp_path, capsys):
    out = tmp_path / "session.csv"
    simulate("gao2017", out=out, poses=50, strategy="measuring", seed=3)
    readings = read_session(out)
    assert len(readings) == 50
    assert readings.points is not None
    told = capsys.readouterr().out
    for word in ("50 readings", "research", "rejected", "nominal error", "noise floor", "mean 0."):
        assert word in told


def test_two_sessions_of_one_arm_have_its_errors_in_common(tmp_path):
    """Points differ from the nominal chain by the same function: the true one of --arm-seed."""
    for seed in (1, 2):
        simulate("gao2017", out=tmp_path / "s.csv", poses=30, seed=seed, arm_seed=4, force=True)
        readings = read_session(tmp_path / "s.csv")
        arm = VirtualArm.draw(load_arm("gao2017"), PRESETS["research"], seed=4)
        assert np.abs(arm.true_tip(readings.angles) - readings.points).max() < 0.06  # noise: 5 sigma of 0.01 mm


def test_seats_are_named_and_points_can_be_left_out(tmp_path, capsys):
    out = tmp_path / "seats.csv"
    simulate("measuring7", out=out, poses=10, strategy="seat", preset="shop", seats=2, no_reference=True, json=True)
    readings = read_session(out)
    assert readings.points is None
    assert readings.seat.tolist() == ["S1"] * 5 + ["S2"] * 5
    result = json.loads(capsys.readouterr().out)
    assert result["n"] == 10
    assert result["noise_floor"] is None
    assert result["nominal_error"]["mean_mm"] < 0.2


@pytest.mark.parametrize("seats", [None, 2])
def test_a_bar_keeps_its_length_wherever_it_lies(tmp_path, seats):
    """An arm without errors holds its tip in the seats: their distance is the bar's, 400 mm, to the encoders' step."""
    out, lengths = tmp_path / "session.csv", tmp_path / "lengths.csv"
    options = {"preset": "perfect", "no_reference": True, "bars": 2, "bar": 400.0, "out_lengths": lengths}
    simulate("gao2017", out=out, poses=35, strategy="seat", seats=seats, **options)
    readings, known = read_session(out), read_lengths(lengths)
    assert len(readings) == 35
    single = 3 if seats is None else seats
    each = 35 // (single + 4)
    names = [f"B{place}{end}" for place in (1, 2) for end in "ab"]
    for name in names:
        assert (readings.seat == name).sum() == each
    assert len(np.unique(readings.seat)) == single + 4
    assert list(zip(known.seat_a.tolist(), known.seat_b.tolist(), strict=True)) == [("B1a", "B1b"), ("B2a", "B2b")]
    assert np.abs(known.length_mm - 400).max() < 5 * known.u_mm[0] == 5 * 0.005
    assert known.length_mm[0] == known.length_mm[1]
    assert known.artefact.tolist() == ["bar 400", "bar 400"]
    tips = load_arm("gao2017").chain.tip_in_base(readings.angles)
    assert np.abs(length_errors(tips, readings.seat, known)).max() < 5 * 0.005 + 1e-3


def test_the_box_can_be_narrowed(tmp_path):
    simulate("gao2017", out=tmp_path / "s.csv", poses=40, half_width_deg=2.0, preset="perfect")
    assert np.ptp(np.degrees(read_session(tmp_path / "s.csv").angles), axis=0).max() < 4


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"strategy": "grid"}, "box, uniform, sobol-box, sobol, measuring, seat, got 'grid'"),
        ({"preset": "laboratory"}, "expected a preset among"),
        ({"seats": 2}, "seats are for the strategy seat, not for box"),
        ({"strategy": "seat", "half_width_deg": 5.0}, "a half width is for the strategies box and sobol-box"),
        ({"poses": 0}, "at least one of poses, got 0"),
        ({"half_width_deg": -5.0}, "positive half-width"),
        ({"strategy": "seat", "bars": 1}, "--bars and --out-lengths belong together"),
        ({"strategy": "seat", "out_lengths": "lengths.csv"}, "--bars and --out-lengths belong together"),
        ({"bars": 1, "out_lengths": "lengths.csv"}, "bars are for the strategy seat, not for box"),
        ({"strategy": "seat", "bars": 1, "out_lengths": "session.csv"}, "are the same file"),
        ({"strategy": "seat", "bars": 1, "out_lengths": "lengths.txt"}, "ends in .csv"),
        ({"strategy": "seat", "bars": 30, "poses": 50, "out_lengths": "lengths.csv"}, "at least one pose a seat"),
        ({"strategy": "seat", "bars": 1, "bar": 9e3, "out_lengths": "lengths.csv"}, "hardly fits into the volume"),
        ({"strategy": "seat", "bars": 1, "seats": 0, "out_lengths": "lengths.csv"}, "at least one pose a seat"),
    ],
)
def test_wrong_options_leave_no_file(tmp_path, options, says):
    out = tmp_path / "session.csv"
    options = {name: tmp_path / value if name == "out_lengths" else value for name, value in options.items()}
    refuses(says, simulate, "gao2017", out=out, **options)
    assert not list(tmp_path.iterdir())
