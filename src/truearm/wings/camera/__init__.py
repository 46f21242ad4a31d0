"""A camera as the instrument: boards, lenses, corners of images, and poses of a board or marker."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES: dict[str, tuple[str, ...]] = {
    "hand_eye": ("HandEyeResult", "hand_eye"),
    "sheets": ("BoardSheet", "draw_board"),
}
COMMANDS: dict[str, str] = {
    "board": "board_command:board",
}
