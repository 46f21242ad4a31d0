"""``truearm export``: the model as a file of another program, and the check of such a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from truearm.choices import Convention
from truearm.errors import InputError
from truearm.verbs.console import print_record, progress
from truearm.verbs.options import AcceptOption, Json, ModelFile
from truearm.wings.exports.correct_command import TipName
from truearm.wings.exports.formats import ExportFormat
from truearm.wings.exports.targets import Frame


def export(
    model: ModelFile,
    out: Annotated[Path | None, Option(help="File to write; its ending states the format.")] = None,
    format: Annotated[
        ExportFormat | None,
        Option("--as", help="The format, where the ending leaves it open.", show_default=False),
    ] = None,
    region: Annotated[
        Path | None,
        Option(help="Session or targets: the poses at which a file of constants must be good; training poses."),
    ] = None,
    source: Annotated[str, Option(help="The robot's own URDF or UR kinematics file, of which all else is kept.")] = "",
    frame: Annotated[
        Frame | None,
        Option(help="Root of a file of constants: the arm's own base (default), or the reference's."),
    ] = None,
    convention: Annotated[
        Convention | None,
        Option(help="Convention of constants: D-H or modified D-H; that of the arm's file."),
    ] = None,
    tip: TipName = None,
    accept: AcceptOption = None,
    check: Annotated[Path | None, Option(help="An exported file to compare with the model, in place of --out.")] = None,
    as_json: Json = False,
) -> None:
    """Write a model as a file of another program.

    .c, .mjs, .onnx and .json hold the whole model. A URDF and tables of constants hold the rigid arm that is nearest to
    it over a region; what is lost is printed and stands in the file. Each file states its origin and has five check
    poses; --check FILE runs them (exit code 1: the file does not agree with the model; 3: nothing differs, but its
    content was not run).
    """
    from truearm.wings.exports.export import check_export
    from truearm.wings.exports.export import export as export_model

    if (out is None) == (check is None):
        raise InputError("expected one of --out and --check", hint="truearm export MODEL --out arm.urdf")
    if check is not None:
        found = check_export(model, check, tip=tip)
        print_record(found, as_json=as_json)
        raise typer.Exit({"agrees": 0, "differs": 1, "not verified": 3}[found.verdict])
    assert out is not None
    with progress(f"exporting {model.name}"):
        result = export_model(
            model,
            out,
            format=format,
            region=region,
            source=source or None,
            frame=frame,
            convention=convention,
            tip=tip,
            accept=accept,
        )
    print_record(result, as_json=as_json, files={result.format: out})
