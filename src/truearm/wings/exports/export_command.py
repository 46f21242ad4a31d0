"""``truearm export``: the model as a file of another program, and the check of such a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from truearm.errors import InputError
from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.wings.exports.correct_command import FrameOption
from truearm.wings.exports.formats import ExportFormat


@options.of_verb("truearm.wings.exports.export:export")
def export(
    verb: Any,
    model: options.ModelFile,
    out: Annotated[Path | None, Option(help="File to write; its ending states the format.")] = None,
    format: Annotated[ExportFormat | None, Option("--as", help="Format of --out.", show_default=False)] = None,
    region: Annotated[
        Path | None,
        Option(help="Session or targets: the poses at which a file of constants must be good; training poses."),
    ] = None,
    source: Annotated[
        str, Option("--original", help="The robot's own file, of which all else is kept: see docs/export.md.")
    ] = "",
    frame: FrameOption = None,
    check: Annotated[Path | None, Option(help="An exported file to compare with the model, in place of --out.")] = None,
    as_json: options.Json = False,
    **given: Any,
) -> None:
    """Write a model as a file of another program.

    .c, .mjs, .onnx and .json hold the whole model. A URDF and tables of constants hold the rigid arm that is nearest to
    it over a region; what is lost is printed and stands in the file. Each file states its origin and has five check
    poses; --check FILE runs them (exit code 1: the file does not agree with the model; 3: nothing differs, but its
    content was not run). Constants are by default in the convention with the nominal arm's numbers, and from the
    arm's own base. --as states the format where the ending leaves it open.
    """
    from truearm.wings.exports.export import check_export

    if (out is None) == (check is None):
        raise InputError("expected one of --out and --check", hint="truearm export MODEL --out arm.urdf")
    if check is not None:
        found = check_export(model, check, tip=given["tip"])
        print_record(found, as_json=as_json)
        raise typer.Exit({"agrees": 0, "differs": 1, "not verified": 3}[found.verdict])
    assert out is not None
    with progress(f"exporting {model.name}"):
        result = verb(model, out, format=format, region=region, source=source or None, frame=frame, **given)
    print_record(result, as_json=as_json, files={result.format: out})
