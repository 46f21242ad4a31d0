"""A page with every kind of figure, for the tests of pages."""

import numpy as np

from truearm.pages.drawings import error_figures as figures
from truearm.pages.drawings import joint_figures
from truearm.pages.drawings.workspace_figures import error_in_workspace, workspace
from truearm.pages.page import Column, LabelledValue, Page, Section, Table
from truearm.pages.plotting import styles_of


def made_up_page(readings=200, joints=6, seed=5):
    """Make a page with every kind of content, of errors with plausible shapes [mm]."""
    random = np.random.default_rng(seed)
    angles = random.uniform(-2.5, 2.5, (readings, joints))
    points = np.column_stack(
        [600 * np.cos(angles[:, 0]), 600 * np.sin(angles[:, 0]), 400 + 300 * np.sin(angles[:, 1 % joints])]
    ) + random.uniform(-90, 90, (readings, 3))
    errors = {
        "nominal": 0.25 * np.sin(angles[:, :1] + np.arange(3)) + 0.2 + random.normal(0, 0.01, (readings, 3)),
        "network": random.normal(0, 0.007, (readings, 3)),
        "kinematic": random.normal(0, 0.006, (readings, 3)),
    }
    lengths = {name: np.linalg.norm(e, axis=1) for name, e in errors.items()}
    styles = styles_of(errors)
    table = Table(
        (Column("model"), Column("mean", "mm"), Column("p95", "mm"), Column("removed", "%"), Column("n")),
        tuple(
            (name, float(d.mean()), np.percentile(d, 95), None if name == "nominal" else 97.3, len(d))
            for name, d in lengths.items()
        ),
        "Error of each model",
    )
    return Page(
        "Error of an arm, before and after",
        "Made up for a test",
        summary=(
            LabelledValue("mean error after", 0.01234, "mm", uncertainty=0.0003, limit=0.05),
            LabelledValue("readings", readings),
        ),
        sections=(
            Section("Before and after", "One.\n\nTwo.", (), (figures.before_after(lengths, styles=styles),), (table,)),
            Section(
                "Measured",
                rows=(LabelledValue("temperature", 20.31, "°C", 0.12), LabelledValue("arm", "virtual")),
                figures=(joint_figures.joint_ranges(angles), workspace(points)),
            ),
            Section(
                "Errors",
                figures=(
                    figures.errors_by_reading(errors, styles=styles),
                    figures.coordinates_by_reading(points, {"network": points + errors["network"]}, styles=styles),
                    figures.error_distribution(lengths, styles=styles),
                    joint_figures.error_against_joint(
                        angles, {name: lengths[name] for name in ("nominal", "kinematic")}, styles=styles
                    ),
                    error_in_workspace(points, lengths["kinematic"], name="kinematic"),
                ),
            ),
        ),
        facts=(("truearm", "0.1"), ("data fingerprint", "sha256:" + "0123456789abcdef" * 4)),
    )
