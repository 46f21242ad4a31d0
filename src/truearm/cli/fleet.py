"""``truearm fleet``: many arms, their readings, models and states."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Exit, Option, Typer

from truearm.choices import ModelName
from truearm.cli.console import print_line, print_record, progress
from truearm.cli.options import ARM_HELP, Json, SchedulerOption, WorkersOption

Folder = Annotated[Path, Argument(metavar="FOLDER", help="Folder of the fleet.")]

fleet = Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Keep many arms: fit them, list their states.",
)


@fleet.command()
def init(
    folder: Folder,
    database: Annotated[
        str, Option(help="Database of the registry, as a URL; relative files of SQLite are in the folder.")
    ] = "sqlite:///registry.sqlite",
) -> None:
    """Make the folder of a fleet and the tables of its registry.

    By default the registry is a file in the folder. PostgreSQL: postgresql+psycopg://USER@HOST/NAME, with the password
    in ~/.pgpass or PGPASSWORD, as the URL is written to a file.
    """
    from truearm.fleet.fleet import Fleet

    with progress(f"making {folder}"):
        Fleet.create(folder, database=database).close()
    print_line(f"{folder}: fleet without arms. Next: truearm fleet add {folder} SERIAL ARM --session FILE")


@fleet.command()
def add(
    folder: Folder,
    serial_number: Annotated[str | None, Argument(metavar="[SERIAL]", help="Serial number of the arm.")] = None,
    arm: Annotated[str | None, Argument(metavar="[ARM]", help=ARM_HELP)] = None,
    session: Annotated[Path | None, Option(help="File of its readings; the last one added is fitted.")] = None,
    site: Annotated[str, Option(help="Where the arm is.")] = "",
    model: Annotated[ModelName | None, Option(help="Kind of model; by default auto, or as before.")] = None,
    every_days: Annotated[int | None, Option(help="Days after which readings are due again.")] = None,
    arms: Annotated[
        Path | None,
        Option("--list", help="Table of many: columns serial_number, arm, and session, site, model, every_days."),
    ] = None,
) -> None:
    """Add an arm, or new readings, site or model of one; with --list all arms of a table, or none of them.

    Files stay where they are. In a list their names are relative to its folder.
    """
    from truearm.errors import InputError
    from truearm.fleet.arm_list import read_arm_list
    from truearm.fleet.fleet import Fleet

    if (arms is None) == (serial_number is None or arm is None):
        raise InputError("expected one arm (SERIAL ARM) or --list TABLE")
    opened = Fleet(folder)
    if arms is not None:
        with progress(f"adding arms of {arms.name}"):
            n = opened.add_all(read_arm_list(arms), beside=arms.absolute().parent)
    else:
        assert serial_number is not None
        assert arm is not None
        n = opened.add(serial_number, arm, session=session, site=site, model=model, every_days=every_days)
    opened.close()
    print_line(f"{n} new in the registry. Next: truearm fleet run {folder}" if n else "Nothing is new.")


@fleet.command()
def run(
    folder: Folder,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    as_json: Json = False,
) -> None:
    """Fit every arm whose readings, drawing or kind of model changed.

    What is fitted already is not fitted again, and an interrupted run is continued by the same command. One arm's
    failure stops no other; a failed or worse fit replaces no model in force. Results are the same whoever computes.
    Exit code 1: some arms failed.
    """
    from truearm.fleet.executors import chosen_executor
    from truearm.fleet.fleet import Fleet

    executor = chosen_executor(workers, scheduler)
    opened = Fleet(folder)
    with progress(f"fitting {folder.name}") as update:
        result = opened.run(executor, progress=update)
    opened.close()
    print_record(result, as_json=as_json)
    raise Exit(1 if result.failures else 0)


@fleet.command()
def status(folder: Folder, as_json: Json = False) -> None:
    """Print the state of every arm: those first that failed, are due, or are worse than others of their type."""
    from truearm.fleet.fleet import Fleet

    opened = Fleet(folder)
    print_record(opened.status(), as_json=as_json)
    opened.close()


@fleet.command()
def report(
    folder: Folder,
    out: Annotated[Path, Option(help="Page to write, .html; pages of the arms stand in a folder beside it.")],
) -> None:
    """Write the overview of all arms as a page that is filtered as you type, and a page of each arm."""
    from truearm.fleet.fleet import Fleet

    opened = Fleet(folder)
    with progress(f"writing {out.name}", total=opened.n_arms) as update:
        n = opened.write_pages(out, progress=update)
    opened.close()
    print_line(f"page written to {out}, with {n} pages of arms beside it")
