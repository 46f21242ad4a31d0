"""Numbered cards with a small drawing each: a gallery on a screen, cards that are not broken between sheets on paper.

A drawing is one polyline per view, in whole pixels; sixty cards take some 60 kB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from truearm.pages.arrays import finite_array
from truearm.typing import FloatArray

_WIDTH, _HEIGHT = 320, 150  # of the views side by side [pixels]
_MARGIN = 8


@dataclass(frozen=True, eq=False)
class Card:
    """One step with its drawing.

    Parameters
    ----------
    title : str
        Beside the box to tick.
    place : str
        A name that is found at a glance, on the right of the title.
    text : str
        What to do.
    values : sequence of (str, str)
        Names and values, with their units.
    lines : sequence of (m, 2) arrays
        A polyline for each view, to the right and up, all in one unit; a dot marks its end.
    """

    title: str
    place: str
    text: str
    values: Sequence[tuple[str, str]]
    lines: Sequence[npt.ArrayLike]


@dataclass(frozen=True, eq=False)
class CardSet:
    """Cards in their order; each shows the line of the one before in a pale colour, to its own scale.

    Parameters
    ----------
    title, caption : str
        A screen shows only the title until a reader opens it.
    views : sequence of str
        What the lines of every card are seen from.
    cards : sequence of Card
    """

    title: str
    caption: str
    views: Sequence[str]
    cards: Sequence[Card]

    def drawings(self) -> list[Markup]:
        """The drawings of the cards as SVG elements; nothing in them but numbers of ours and escaped titles.

        Raises
        ------
        InputError
            If a line is not an (m, 2) array of finite numbers.
        """
        lines = [
            [finite_array(line, f"line of the card {card.title!r}", width=2) for line in card.lines]
            for card in self.cards
        ]
        views, nothing = " and ".join(self.views), [line[:0] for line in lines[0]]
        return [
            _drawing(now, before, f"{card.title}, {views}")
            for card, now, before in zip(self.cards, lines, [nothing, *lines[:-1]], strict=True)
        ]


def _drawing(now: Sequence[FloatArray], before: Sequence[FloatArray], label: str) -> Markup:
    """The views side by side to one scale, each in the middle of its share of the width."""
    share = _WIDTH / len(now)
    ends = [(both.min(axis=0), both.max(axis=0)) for both in map(np.vstack, zip(now, before, strict=True))]
    across, up = np.max([high - low for low, high in ends], axis=0)
    scale = min((share - 2 * _MARGIN) / max(across, 1e-9), (_HEIGHT - 2 * _MARGIN) / max(up, 1e-9))
    pale, dark, marks = [], [], []
    for view, (low, high) in enumerate(ends):
        middle, centre = (low + high) / 2, np.array([(view + 0.5) * share, _HEIGHT / 2])
        old, line = ((centre + (part[view] - middle) * (scale, -scale)).round().astype(int) for part in (before, now))
        pale += [_polyline(old)] if len(old) else []
        dark.append(_polyline(line))
        (x, y), (end_x, end_y) = line[0], line[-1]
        marks.append(Markup('<path d="M%d %dh12"/><circle cx="%d" cy="%d" r="4"/>') % (x - 6, y, end_x, end_y))
    return Markup('<svg viewBox="0 0 %d %d" role="img" aria-label="%s"><g class="before">%s</g>%s%s</svg>') % (
        *(_WIDTH, _HEIGHT, label),
        *(Markup("").join(part) for part in (pale, dark, marks)),
    )


def _polyline(line: npt.NDArray[np.int64]) -> Markup:
    """A polyline without points that coincide with those before them."""
    kept = np.concatenate([[True], np.any(np.diff(line, axis=0) != 0, axis=1)])
    return Markup('<polyline points="%s"/>') % " ".join(f"{x},{y}" for x, y in line[kept].tolist())
