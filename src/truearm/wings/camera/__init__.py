"""A camera as the instrument: boards, lenses, corners of images, and poses of a board or marker."""

from typing import Literal

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES: dict[str, tuple[str, ...]] = {
    "fit_images": ("ImageFit", "fit_images"),
    "hand_eye": ("HandEyeResult", "hand_eye"),
    "sheets": ("BoardSheet", "draw_board"),
}
COMMANDS: dict[str, str] = {
    "board": "board_command:board",
    "fit-images": "fit_images_command:fit_images",
    "hand-eye": "hand_eye_command:hand_eye",
}
# Formats of transforms.
TransformFormat = Literal["ros-transform", "easy-handeye", "yaml"]
