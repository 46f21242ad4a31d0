"""The colours of pages and figures, each for light and for dark screens, and their contrasts.

A figure is drawn once, in light colours; on a page each colour is a CSS variable, which a dark screen replaces. The
dark value of a colour of series is what ``filter: invert(1) hue-rotate(180deg)`` (CSS Filter Effects, Level 1) makes of
the light one, so that dots in a bitmap, which can only be filtered, have the colour of the lines beside them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Colour:
    """A colour of the pages, ``#rrggbb`` on light and on dark screens."""

    name: str
    light: str
    dark: str


def filtered(light: str) -> str:
    """The colour that ``filter: invert(1) hue-rotate(180deg)`` makes of another one, both ``#rrggbb``."""
    red, green, blue = (255 - value for value in channels(light))
    # The matrix of hue-rotate(180deg) in CSS Filter Effects, 12.1.
    turned = (
        -0.574 * red + 1.430 * green + 0.144 * blue,
        0.426 * red + 0.430 * green + 0.144 * blue,
        0.426 * red + 1.430 * green - 0.856 * blue,
    )
    return "#" + "".join(f"{min(max(round(value), 0), 255):02x}" for value in turned)


def channels(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour ``#rrggbb``, 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


# Of figures -----------------------------------------------------------------------------------------------------------

PAPER, INK, SOFT = "#ffffff", "#1a1a1a", "#5a616b"
FAINT, LIMIT = "#d9dce0", "#8a9099"  # grids and hairlines; axes and limits
PALE = "#e4ebf3"  # an area behind the data
# Orange, navy, purple: apart for every common colour blindness, and 59, 26 and 45 in lightness on grey paper.
ORANGE, NAVY, PURPLE, TEAL, GREY, OLIVE = "#d9730d", "#12407a", "#a8488f", "#2f8f8b", "#6b7078", "#8a7a00"
GOOD, DOUBTFUL, BAD = "#1a7f37", "#946200", "#c0231c"

PALETTE = (
    Colour("paper", PAPER, "#15181d"),
    Colour("ink", INK, "#e6e8eb"),
    Colour("soft", SOFT, "#a3abb6"),
    Colour("faint", FAINT, "#363d47"),
    Colour("limit", LIMIT, "#7d8590"),
    Colour("pale", PALE, "#25303d"),
    Colour("wash", "#f6f7f8", "#1d2127"),
    *(
        Colour(name, light, filtered(light))
        for name, light in {
            "orange": ORANGE,
            "navy": NAVY,
            "purple": PURPLE,
            "teal": TEAL,
            "grey": GREY,
            "olive": OLIVE,
        }.items()
    ),
    Colour("good", GOOD, "#4cc26a"),
    Colour("doubtful", DOUBTFUL, "#e0a82e"),
    Colour("bad", BAD, "#ff7b72"),
    Colour("good-wash", "#eaf6ec", "#14261a"),
    Colour("doubtful-wash", "#fdf4dd", "#2a2312"),
    Colour("bad-wash", "#fdeceb", "#301918"),
)
_NAMES = {colour.light: colour.name for colour in PALETTE}
_ONE_OF_THEM = re.compile("|".join(_NAMES))


def style_rules() -> str:
    """The palette as CSS variables: light, dark where the reader prefers it, and always light on paper."""
    light = "".join(f"--{colour.name}:{colour.light};" for colour in PALETTE)
    dark = "".join(f"--{colour.name}:{colour.dark};" for colour in PALETTE)
    return (
        f":root,.light-paper{{{light}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}.light-paper{{{light}}}}}\n"
    )


def with_variables(style: str) -> str:
    """Replace the palette's colours in a CSS value by variables; outside a page the light colours remain."""
    return _ONE_OF_THEM.sub(lambda found: f"var(--{_NAMES[found[0]]},{found[0]})", style)
