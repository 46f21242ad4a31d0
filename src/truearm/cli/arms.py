"""``truearm arms``: the arms of the catalogue, one arm's drawing, or an arm file to start one's own from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import is_zipfile

import typer

from truearm.cli.console import Json, check_output_is_not_input, print_json, print_line, print_table

if TYPE_CHECKING:
    from truearm.arm import Arm


def arms(
    arm: Annotated[
        str,
        typer.Argument(
            metavar="[ARM]", help="A name, an arm (.toml) or URDF file, or a model file.", show_default=False
        ),
    ] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Write it as an arm file, .toml or .urdf.")] = None,
    convention: Annotated[
        Literal["dh", "mdh"], typer.Option("--convention", help="Of the table that is shown or written.")
    ] = "dh",
    as_json: Json = False,
) -> None:
    """List the arms known by name, or show or write one.

    Without a name: the list. With a name: its drawing. With a model file: the arm as identified, base and tip where the
    reference saw them. With --out as well: an arm file, to edit into your own arm's, or to use elsewhere.
    """
    from truearm.arm import list_arms, load_arm, write_arm
    from truearm.errors import InputError

    if not arm:
        if out is not None:
            raise InputError("--out needs the name of an arm", hint="truearm arms gao2017 --out my-arm.toml")
        listed = [load_arm(name) for name in list_arms()]
        if as_json:
            print_json({a.name: {"title": a.title, "n_joints": a.n_joints, "reach_mm": a.chain.reach} for a in listed})
        else:
            rows = [[a.name, str(a.n_joints), f"{a.chain.reach:.0f}", a.title] for a in listed]
            print_table(["name", "joints", "reach mm", "what it is"], rows, left_aligned=(0, 3))
        return
    chosen = _identified(Path(arm)) if Path(arm).is_file() and is_zipfile(arm) else load_arm(arm)
    if out is not None:
        check_output_is_not_input(out, Path(arm))
        write_arm(chosen, out, convention=convention)
        print_line(f"{out}: {chosen.name}, {chosen.n_joints} joints")
    elif as_json:
        print_json(_facts(chosen, convention))
    else:
        _show(chosen, convention)


def _identified(path: Path) -> Arm:
    """The arm of a model file with the constants that were identified."""
    from dataclasses import replace

    from truearm.compensation.models import NetworkModel
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError

    model = load_model(path)
    if isinstance(model, NetworkModel):
        raise InputError("a network model has no arm in it to show", file=path, hint="a kinematic model has")
    assert isinstance(model, IdentifiedModel)  # all others
    found = model.fit_.chain
    # The base frame is the reference's now, in which weight pulls elsewhere.
    turn = found.fixed[0, :3, :3] @ model.arm.chain.fixed[0, :3, :3].T
    return replace(
        model.arm,
        chain=found,
        gravity_in_base=turn @ model.arm.gravity_direction,
        name=f"{model.arm.name}-identified",
        title=f"{model.arm.title}, identified from {model.n_train_} readings".strip(", "),
    )


def _facts(arm: Arm, convention: Literal["dh", "mdh"]) -> dict[str, Any]:
    """The drawing: a D-H table where the arm has one, the fixed motions between its joints anyway."""
    import numpy as np

    from truearm.arm import dh_table, mdh_table
    from truearm.arm.transforms import xyz_rpy_from_frame
    from truearm.errors import InputError

    frames = [xyz_rpy_from_frame(frame) for frame in arm.chain.fixed]
    facts: dict[str, Any] = {
        "name": arm.name,
        "title": arm.title,
        "source": arm.source,
        "joint_names": list(arm.joint_names),
        "fixed_xyz_mm": [xyz.tolist() for xyz, _ in frames],
        "fixed_rpy_deg": [np.degrees(rpy).tolist() for _, rpy in frames],
        "tip_in_flange_mm": arm.chain.tip_in_flange.tolist(),
        "reach_mm": arm.chain.reach,
        "gravity_in_base": arm.gravity_direction.tolist(),
    }
    if arm.masses is not None:
        facts["mass_kg"] = arm.masses.mass_kg.tolist()
    try:
        table = (dh_table if convention == "dh" else mdh_table)(arm.chain)
    except InputError:  # axes that miss being parallel by little have no bounded table
        return facts
    facts[convention] = {
        "a_mm": table.a.tolist(),
        "d_mm": table.d.tolist(),
        "alpha_deg": np.degrees(table.alpha).tolist(),
        "theta_deg": np.degrees(table.theta).tolist(),
    }
    return facts


def _show(arm: Arm, convention: Literal["dh", "mdh"]) -> None:
    import numpy as np

    facts = _facts(arm, convention)
    columns = facts.get(convention)
    if columns is None:
        frames = np.hstack([facts["fixed_xyz_mm"], facts["fixed_rpy_deg"]])[1:]
        heads = ["x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
        columns = dict(zip(heads, frames.T.tolist(), strict=True))
    rows = []
    for i, name in enumerate(arm.joint_names):
        unit, limits = ("mm", arm.limits[i]) if arm.chain.is_prismatic[i] else ("deg", np.degrees(arm.limits[i]))
        ends = [f"{end:.1f}" for end in limits]
        rows.append([name, *(f"{column[i]:.4f}" for column in columns.values()), *ends, unit])
    print_line(f"{arm.name}: {arm.title}")
    print_table(["joint", *columns, "min", "max", ""], rows)
    if (arm.chain.fixed[0] != np.eye(4)).any():
        xyz, rpy = (", ".join(f"{v:.4f}" for v in facts[key][0]) for key in ("fixed_xyz_mm", "fixed_rpy_deg"))
        print_line(f"before joint 1: {xyz} mm, roll pitch yaw {rpy} deg")
    print_line(f"tip in the flange: {', '.join(f'{x:.4f}' for x in facts['tip_in_flange_mm'])} mm")
    if arm.masses is not None:
        print_line(f"masses of the links: {', '.join(f'{mass:.4g}' for mass in arm.masses.mass_kg)} kg")
    if (arm.gravity_direction != [0, 0, -1]).any():
        print_line(f"weight pulls along {', '.join(f'{x:.4f}' for x in arm.gravity_direction)} of the base frame")
    print_line(f"source: {arm.source}")
