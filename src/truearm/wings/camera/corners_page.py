"""The page of the corners: how they scatter, and every image with its corners and residuals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure as Drawing

from truearm.number_format import format_count, format_number
from truearm.pages.page import Cell, Column, LabelledValue, Page, PageVerdict, Section, State, Table
from truearm.pages.palette import NAVY, ORANGE
from truearm.pages.plotting import Figure, figure_style
from truearm.typing import FloatArray
from truearm.wings.camera.detection import SeenImage
from truearm.wings.camera.images import Adjustment

# Images that are drawn: those without a board, those with the largest residuals, and others up to this number.
MOST_DRAWN = 60
# Grey levels of the small images: more only make the page larger.
LEVELS = 16
# A residual of the typical size is drawn with this length [px of the small image].
TYPICAL_LENGTH = 8.0


def corners_page(
    images: Sequence[SeenImage],
    adjusted: Adjustment | None,
    *,
    board: str,
    size_px: tuple[int, int],
    said: str,
    assumed: Sequence[str],
) -> Page:
    """Lay out the corners of images.

    Parameters
    ----------
    images : sequence of SeenImage
    adjusted : Adjustment or None
        Poses of the board in the images that show it, and the camera.
    board : str
        Its name.
    size_px : (int, int)
        Width and height of the images.
    said : str
        The answer in one sentence.
    assumed : sequence of str
        What was assumed.
    """
    found = [image for image in images if len(image.detection)]
    n_corners, n_missed = sum(len(image.detection) for image in found), len(images) - len(found)
    summary = [LabelledValue("images with the board", len(found)), LabelledValue("corners", n_corners)]
    residuals: dict[str, FloatArray] = {}
    if adjusted is not None:
        summary.append(LabelledValue("scatter of a coordinate", float(adjusted.std_px[0]), "px"))
        each = zip(found, adjusted.residuals, strict=True)
        residuals = {image.name: part[:, ~np.isnan(part[0])] for image, part in each}
    detail = f"{format_count(n_missed, 'image')} without: they are the first below." if n_missed else ""
    return Page(
        title=f"Corners of {board} in {format_count(len(images), 'image')}",
        subtitle="Corners of a board in the images of a camera, for the identification of an arm.",
        summary=tuple(summary),
        sections=(
            _images(images, residuals, typical=1.0 if adjusted is None else float(adjusted.std_px[0])),
            _table(images, residuals, adjusted),
        ),
        facts=(
            ("board", board),
            ("image", f"{size_px[0]} x {size_px[1]} px"),
            ("assumed", " ".join(assumed) or "nothing"),
        ),
        verdict=PageVerdict(said, state="doubtful" if n_missed else "none", detail=detail),
    )


def _rms(residual: FloatArray | None) -> float | None:
    return None if residual is None else float(np.sqrt((residual**2).mean()))


def _images(images: Sequence[SeenImage], residuals: dict[str, FloatArray], *, typical: float) -> Section:
    worst = sorted(images, key=lambda one: (len(one.detection) > 0, -(_rms(residuals.get(one.name)) or 0.0)))
    drawn = sorted(worst[:MOST_DRAWN], key=lambda one: (len(one.detection) > 0, one.reading))
    said = (
        f"Orange: the corners that were found. Blue: from each corner to where the board has it, "
        f"enlarged: {TYPICAL_LENGTH:g} px of the small image are {format_number(typical)} px of the camera."
    )
    if len(drawn) < len(images):
        said += f" {len(drawn)} of {len(images)} images are drawn, those with the largest residuals among them."
    with figure_style():
        panels = tuple(_panel(image, residuals.get(image.name), typical) for image in drawn)
    alt = f"{len(drawn)} small images with the corners of the board."
    return Section("Images", figures=(Figure(panels, said, alt, columns=3, light_paper=True),))


def _panel(image: SeenImage, residual: FloatArray | None, typical: float) -> Drawing:
    height, width = image.small.shape
    across, top = 2.6, 0.26  # [in]
    along = across * height / width
    drawing = Drawing(figsize=(across, along + top))
    axes = drawing.add_axes((0, 0, 1, along / (along + top)))
    grey = np.round(image.small / 255 * (LEVELS - 1)) / (LEVELS - 1)
    axes.imshow(grey, cmap="gray", vmin=0, vmax=1, extent=(0, width, height, 0), interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    name = image.name if len(image.name) <= 24 else f"{image.name[:23]}\u2026"
    n = len(image.detection)
    axes.set_title(f"{image.reading}: {name}, {format_count(n, 'corner') if n else 'no board'}", parse_math=False)
    if n:
        u, v = (image.detection.pixels.T + 0.5) / image.shrink
        axes.plot(u, v, "o", color=ORANGE, markersize=1.5, markeredgewidth=0)
        if residual is not None:
            du, dv = residual * TYPICAL_LENGTH / typical
            gap = np.full(n, np.nan)
            axes.plot(
                np.stack([u, u + du, gap], axis=1).ravel(),
                np.stack([v, v + dv, gap], axis=1).ravel(),
                color=NAVY,
                linewidth=0.8,
            )
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    return drawing


def _table(images: Sequence[SeenImage], residuals: dict[str, FloatArray], adjusted: Adjustment | None) -> Section:
    poses = {}
    if adjusted is not None:
        for name, R, t in zip(residuals, adjusted.R, adjusted.t, strict=True):
            sight = t / np.linalg.norm(t)
            poses[name] = float(np.linalg.norm(t)), float(np.degrees(np.arccos(min(1.0, abs(R[:, 2] @ sight)))))

    def rows() -> Iterator[tuple[Cell, ...]]:
        for image in images:
            residual = residuals.get(image.name)
            largest = None if residual is None else float(np.hypot(*residual).max())
            distance, tilt = poses.get(image.name, (None, None))
            n = len(image.detection)
            yield image.reading, image.name, n, _rms(residual), largest, distance, tilt, image.detection.problem

    columns = Column.of(
        "reading", "image", "corners", "rms [px]", "largest [px]", "distance [mm]", "tilt [deg]", "problem"
    )
    caption = (
        "Every image. Distance and tilt are those of the board from the camera; the focal length is found from the "
        "images unless the camera is stated."
    )
    states: tuple[State, ...] = tuple("doubtful" if image.detection.problem else "none" for image in images)
    return Section("Image by image", tables=(Table(columns, tuple(rows()), caption, states=states),))
