"""``truearm sources``: what can be connected, and a first look at it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from truearm.verbs import options
from truearm.verbs.console import print_record, progress
from truearm.verbs.outputs import check_new_output


def sources(
    context: typer.Context,
    source: Annotated[
        str | None, Option("--try", metavar="SOURCE", help="Read this source and show ten samples.")
    ] = None,
    arm: options.ArmOption = None,
    seconds: Annotated[float, Option(min=0.1, max=600, help="With --try: for how long.")] = 5.0,
    out: Annotated[
        Path | None, Option(help="With --try: arm file to write, .toml, with the constants that a MicroScribe states.")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """List what can be connected, or say what is wrong with it.

    --try prints ten samples and what is probably wrong. Move every joint while it runs. It finds joints that never
    move, units by the size of the angles, and with --arm signs and zeros by the limits of the joints. Without a sample
    the exit code is 1.
    """
    from truearm.arm import write_arm
    from truearm.wings.bench.recording.sources import list_sources, try_source
    from truearm.wings.bench.sources.source_names import read_source_arm

    if source is None:
        options.refuse_typed(context, ["arm", "seconds", "out", "force"], "applies to --try only")
        print_record(list_sources(), as_json=as_json)
        return
    if out is not None:
        check_new_output(out, force=force)
        write_arm(read_source_arm(source), out, convention="mdh")
    with progress(f"reading {source}: move every joint"):
        trial = try_source(source, arm=arm, seconds=seconds)
    print_record(trial, as_json=as_json, files={"arm": out})
    if not trial.samples:
        raise typer.Exit(1)
