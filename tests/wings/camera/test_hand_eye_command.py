"""``truearm hand-eye``: its files, and what it refuses."""

import json

import numpy as np
import pytest
from hand_eye_cells import make_cell
from scipy.spatial.transform import Rotation

import truearm as ta


@pytest.fixture
def tables(tmp_path, monkeypatch):
    """Files of a cell: the board, joints and the flange."""
    monkeypatch.chdir(tmp_path)
    cell = make_cell(1, 20, errors=(5e-4, 0.3), noise=(0.02, 0.1))
    for name, T in (("board", cell.seen), ("flange", cell.flange)):
        rows = np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()])
        np.savetxt(f"{name}.csv", rows, delimiter=",", header="x_mm,y_mm,z_mm,qx,qy,qz,qw", comments="")
    header = ",".join(f"q{k}_rad" for k in range(1, 7))
    np.savetxt("joints.csv", cell.joints, delimiter=",", header=header, comments="")
    return cell


def test_it_writes_a_model_of_the_board_in_the_camera(tables, truearm, tmp_path):
    ran = truearm("hand-eye", "board.csv", "joints.csv", "--arm", "ur10", "--out-model", "m.truearm", "--json").done()
    printed = json.loads(ran.out)
    assert [(one["child"], one["parent"]) for one in printed["transforms"]] == [
        ("camera", "base"),
        ("board", "flange"),
        ("base", "camera"),
        ("flange", "board"),
    ]
    assert printed["held_out"]["arm_identified_mm"] < printed["held_out"]["hand_eye_alone_mm"]
    points = ta.load_model(tmp_path / "m.truearm").predict(tables.joints)
    assert np.linalg.norm(points - tables.seen[:, :3, 3], axis=1).mean() < 0.5  # mm; noise of 0.1 mm a coordinate


def test_a_transform_that_is_there_is_kept(tables, truearm, tmp_path):
    words = ("hand-eye", "board.csv", "flange.csv", "--out", "t.yaml", "--as", "yaml")
    truearm(*words).done()
    before = (tmp_path / "t.yaml").read_bytes()
    assert "exists" in truearm(*words).refused().err
    assert (tmp_path / "t.yaml").read_bytes() == before
    truearm(*words, "--force").done()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["board.csv", "joints.csv"], "joints need the nominal arm"),
        (["board.csv", "joints.csv", "--arm", "panda"], "expected 7 joints of panda, got 6"),
        (["board.csv", "flange.csv", "--out", "t.yaml"], "--out and --as belong together"),
        (["board.csv", "flange.csv", "--out-model", "m.truearm"], "without joints there is no model to write"),
        (["board.csv", "flange.csv", "--rotation", "zzz"], "expected a form of rotations, got 'zzz'"),
        (["board.csv", "flange.csv", "--board-size", "0"], "expected a board size above zero"),
        (["board.csv"], "expected joints or poses of the flange, got none"),
        (
            ["board.csv", "flange.csv", "--out", "t", "--as", "yaml", "--frame-names", "a,b"],
            "names of base, flange and camera",
        ),
    ],
)
def test_it_refuses_and_writes_nothing(words, said, tables, truearm, tmp_path):
    before = set(tmp_path.iterdir())
    assert said in truearm("hand-eye", *words).refused().err
    assert set(tmp_path.iterdir()) == before
