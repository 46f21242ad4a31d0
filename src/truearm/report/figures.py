"""Every figure of a report, under one name: functions of arrays that give a `Figure`."""

from truearm.report.by_reading import coordinates_by_reading, errors_by_reading
from truearm.report.canvas import Figure, Style, save_png, styles_of
from truearm.report.joints import error_against_joint, joint_ranges
from truearm.report.space import error_in_workspace, workspace
from truearm.report.spread import before_after, error_distribution

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
