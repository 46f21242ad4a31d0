"""``truearm predict``: corrected coordinates with uncertainties, from angles alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truearm.cli.console import say

if TYPE_CHECKING:
    from truearm.models import Compensator
    from truearm.readings import Readings


def predict(
    model: Annotated[Path, typer.Argument(help="Model file.")],
    session: Annotated[Path, typer.Argument(help="Session file; only its angles are used.")],
    out: Annotated[Path, typer.Option("--out", help="Table of points to write, .csv.")],
) -> None:
    """Compensate: turn joint angles into corrected coordinates.

    Columns: x_mm, y_mm, z_mm in the frame of the reference; sx_mm, sy_mm, sz_mm standard uncertainties;
    outside_training 1 where a joint is beyond the angles the model learned from; seat, position, session as given.
    """
    import numpy as np
    import pandas as pd

    from truearm.writing import whole_file

    fitted, readings = load_for(model, session)
    points, covariance = fitted.predict(readings.angles, return_cov=True)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    outside = fitted.outside_training(readings.angles)
    columns: dict[str, object] = {f"{axis}_mm": points[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"s{axis}_mm": std[:, i] for i, axis in enumerate("xyz")}
    columns["outside_training"] = outside.astype(int)
    for name in ("seat", "position", "session"):
        if getattr(readings, name) is not None:
            columns[name] = getattr(readings, name)
    with whole_file(out) as beside:
        pd.DataFrame(columns).to_csv(beside, index=False)
    say(f"{out}: {len(points)} points, standard uncertainty of a coordinate {np.median(std):.4f} mm (median)")
    if outside.any():
        say(
            f"{int(outside.sum())} of {len(points)} readings have a joint beyond the training angles: "
            "do not rely on them."
        )


def load_for(model: Path, session: Path) -> tuple[Compensator, Readings]:
    """A model and the readings it is asked about, checked against each other."""
    from truearm.models.file import load_model
    from truearm.readings import check_angles, read_session

    fitted = load_model(model)
    readings = read_session(session, n_joints=fitted.arm.n_joints)
    lower, upper = fitted.arm.limits.T
    check_angles(
        readings,
        joint_names=fitted.arm.joint_names,
        lower=lower,
        upper=upper,
        prismatic=fitted.arm.chain.prismatic,
    )
    return fitted, readings
