"""Every figure of a report, under one name: functions of arrays that give a `Figure`."""

from truearm.pages.distribution_figures import before_after, error_distribution
from truearm.pages.joint_figures import error_against_joint, joint_ranges
from truearm.pages.plotting import Figure, Style, save_png, styles_of
from truearm.pages.reading_figures import coordinates_by_reading, errors_by_reading
from truearm.pages.workspace_figures import error_in_workspace, workspace

__all__ = [
    "Figure",
    "Style",
    "before_after",
    "coordinates_by_reading",
    "error_against_joint",
    "error_distribution",
    "error_in_workspace",
    "errors_by_reading",
    "joint_ranges",
    "save_png",
    "styles_of",
    "workspace",
]
