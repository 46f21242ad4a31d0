"""A camera, boards before it, and their rendered images."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truearm.wings.camera.boards import parse_board
from truearm.wings.camera.lenses import Lens

LENS = Lens(640, 512, 800.0, 802.0, 323.0, 250.0, "brown", [-0.12, 0.08, 4e-4, -3e-4, 0.01])


@pytest.fixture(scope="session")
def lens():
    return LENS


@pytest.fixture(scope="session")
def view():
    """What makes an image of a board, by its text: the image, and where its corners truly are, (n, 2)."""
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    from truearm.wings.camera.patterns import pattern_of
    from truearm.wings.camera.simulate_images import Renderer

    def seen(text, *, seed=0, tilt=(0.25, -0.3, 0.2), distance=330.0, blur_px=0.7, noise=2.0, lens=LENS):
        board = parse_board(text)
        T = np.eye(4)
        front = np.diag([1.0, -1.0, -1.0]) if board.kind == "aprilgrid" else np.eye(3)
        T[:3, :3] = Rotation.from_rotvec(tilt).as_matrix() @ front
        T[:3, 3] = [5.0, -4.0, distance] - T[:3, :3] @ board.points.mean(axis=0)
        image = Renderer(pattern_of(board), lens, blur_px, noise).image(T, seed=seed)
        return image, lens.project(T[:3, :3] @ board.points.T + T[:3, 3:]).T

    return seen
