"""The page about hand-eye prints what it says, and names what there is."""

import numpy as np
import pytest
import yaml
from hand_eye_cells import make_cell
from scipy.spatial.transform import Rotation

from page_transcripts import DOCS, block, check_printed, commands
from truearm.wings.camera import TransformFormat
from truearm.wings.camera.pose_files import ALIASES


def write_samples(path):
    """As easy_handeye2 writes them with a camera on the flange."""
    cell = make_cell(5, 20, eye_in_hand=True, errors=(2e-4, 0.2), noise=(0.05, 0.3))
    sides = []
    for T in (cell.flange, cell.seen):
        quaternions = Rotation.from_matrix(T[:, :3, :3]).as_quat()
        sides.append([
            {"translation": dict(zip("xyz", t, strict=True)), "rotation": dict(zip("xyzw", q, strict=True))}
            for t, q in zip((T[:, :3, 3] / 1000).tolist(), quaternions.tolist(), strict=True)
        ])  # fmt: skip
    samples = [{"robot": robot, "tracking": tracking} for robot, tracking in zip(*sides, strict=True)]
    path.write_text(yaml.safe_dump({"parameters": {"calibration_type": "eye_in_hand"}, "samples": samples}))


def write_cell(path):
    """Joints and the board in a camera that stands; two images have a board that is seen half turned."""
    cell = make_cell(6, 30, errors=(7e-4, 0.4), noise=(0.05, 0.2))
    seen = cell.seen.copy()
    for row in (8, 21):
        seen[row, :3, :3] = seen[row, :3, :3] @ np.diag([-1.0, -1.0, 1.0])
    names = [f"q{k}_deg" for k in range(1, 7)] + ["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
    rows = np.hstack([np.degrees(cell.joints), seen[:, :3, 3], Rotation.from_matrix(seen[:, :3, :3]).as_quat()])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


@pytest.fixture
def cell_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_samples(tmp_path / "my_calib.samples")
    write_cell(tmp_path / "cell.csv")
    return tmp_path


@pytest.mark.parametrize("name", ["samples", "joints"])
def test_its_walks_print_what_they_say(name, cell_folder, truearm):
    for (_, *arguments), shown in commands(block("hand-eye.md", f"console {name}")):
        ran = truearm(*arguments).done()
        if shown:
            check_printed(shown, ran.out.strip().splitlines())
    assert (cell_folder / "camera.yaml").exists() == (name == "samples")


def test_it_names_every_form_and_format():
    text = (DOCS / "hand-eye.md").read_text(encoding="utf-8")
    for word in (*ALIASES, *TransformFormat.__args__, "xyzw", "wxyz", "rotvec:rad"):
        assert f"`{word}`" in text, word
