"""A camera as the instrument: boards, lenses, corners of images, and poses of a board or marker."""

from typing import Literal

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES: dict[str, tuple[str, ...]] = {
    "fit_images": ("ImageFit", "fit_images"),
    "hand_eye": ("HandEyeResult", "hand_eye"),
    "find_corners": ("CornersResult", "find_corners"),
    "plan_images": ("ImagePlan", "plan_images"),
    "sheets": ("BoardSheet", "draw_board"),
    "simulate_images": ("ImageSimulation", "simulate_images"),
}
COMMANDS: dict[str, str] = {
    "board": "commands:board",
    "plan-images": "commands:plan_images",
    "fit-images": "commands:fit_images",
    "hand-eye": "commands:hand_eye",
    "corners": "commands:corners",
}
# What truearm simulate --instrument measures a virtual arm with.
INSTRUMENTS = {"camera": "simulate_images:write_simulation", "camera-in-hand": "simulate_images:write_simulation"}
# Formats of transforms.
TransformFormat = Literal["ros-transform", "easy-handeye", "yaml"]
