"""``truearm fleet``: many arms, their readings, models and states."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Context, Exit, Option, Typer

from truearm.verbs import options
from truearm.verbs.console import print_line, print_record, progress
from truearm.verbs.outputs import check_new_output
from truearm.wings.laboratory.verbs.commands import CheckOptions
from truearm.wings.laboratory.verbs.verify_command import Trusted

if TYPE_CHECKING:
    from truearm.wings.fleet.fleet import Fleet
    from truearm.wings.laboratory.verbs.check import WithdrawalResult

Folder = Annotated[Path, Argument(metavar="FOLDER", help="Folder of the fleet.")]
Verify = Annotated[
    bool, Option("--verify", help="Read every session file, also those of which size and time are as they were.")
]

fleet = Typer(rich_markup_mode=None, no_args_is_help=True, help="Keep many arms: fit them, list their states.")


@contextmanager
def opened(folder: Path) -> Iterator[Fleet]:
    """The fleet of a folder, closed at the end."""
    from truearm.wings.fleet.fleet import Fleet  # no help waits for it

    found = Fleet(folder)
    try:
        yield found
    finally:
        found.close()


@fleet.command()
def init(
    folder: Folder,
    database: Annotated[
        str, Option(help="Database of the registry, as a URL; relative files of SQLite are in the folder.")
    ] = "sqlite:///registry.sqlite",
) -> None:
    """Make the folder of a fleet, with its registry.

    By default the registry is a file in the folder. PostgreSQL: postgresql+psycopg://USER@HOST/NAME, with the password
    in ~/.pgpass or PGPASSWORD, as the URL is written to a file.
    """
    from truearm.wings.fleet.fleet import Fleet

    with progress(f"making {folder}"):
        Fleet.create(folder, database=database).close()
    print_line(f"{folder}: fleet without arms. Next: truearm fleet add {folder} SERIAL ARM --session FILE")


@fleet.command()
def add(
    folder: Folder,
    serial_number: Annotated[str | None, Argument(metavar="[SERIAL]", help="Serial number of the arm.")] = None,
    arm: Annotated[str | None, Argument(metavar="[ARM]", help=options.ARM_HELP)] = None,
    session: Annotated[
        str | None, Option(help="File of its readings, or a URL (s3://..); the last one added is fitted.")
    ] = None,
    site: Annotated[str, Option(help="Where the arm is.")] = "",
    model: options.ModelOption = None,
    every_days: Annotated[int | None, Option(help="Days after which readings are due again.")] = None,
    arms: Annotated[
        Path | None,
        Option("--list", help="Table of many: columns serial_number, arm, and session, site, model, every_days."),
    ] = None,
) -> None:
    """Add an arm, or new readings, site or model of one.

    With --list all arms of a table, or none of them. ARM is needed of a new one. --model is by default
    auto, or as before. Files stay where they are. In a list their names are relative to its folder.
    """
    from truearm.errors import InputError
    from truearm.wings.fleet.arm_list import read_arm_list

    if (arms is None) == (serial_number is None):
        raise InputError("expected one arm (SERIAL ARM) or --list TABLE")
    with opened(folder) as found, progress(f"adding {serial_number if arms is None else f'arms of {arms.name}'}"):
        if arms is not None:
            n = found.add_all(read_arm_list(arms), beside=arms.absolute().parent)
        else:
            assert serial_number is not None
            n = found.add(serial_number, arm, session=session, site=site, model=model, every_days=every_days)
    print_line(f"{n} new in the registry. Next: truearm fleet run {folder}" if n else "Nothing is new.")


@fleet.command()
def remove(
    folder: Folder, serial_number: Annotated[str, Argument(metavar="SERIAL", help="Serial number of the arm.")]
) -> None:
    """Take an arm off the fleet.

    Its readings, fits, checks and certificates are no longer in the registry. Session files, certificates, model files
    and the results of its fits (Parquet) stay.
    """
    from truearm.verbs.record import number_of

    with opened(folder) as found:
        gone = found.remove(serial_number)
    counts = [number_of(gone[table], table[:-1]) for table in ("sessions", "fits", "checks", "certificates")]
    print_line(
        f"{serial_number} is no longer in the registry, nor are its {', '.join(counts)}. "
        f"Its files stay, and its results in {folder / 'results'}."
    )


@fleet.command()
def add_certificate(
    folder: Folder,
    files: Annotated[list[Path], Argument(metavar="FILE...", help="Certificates (DCC), .xml or .pdf.")],
    due: Annotated[
        str | None, Option(help="Day of the next calibration, 2027-11-03; by default that of the certificate.")
    ] = None,
    trusted: Trusted = None,
) -> None:
    """Add calibration certificates of arms, all or none.

    Each states the serial number of its arm. The registry keeps number, day, verdict, the day of the next calibration
    and the SHA-256 of the file. A certificate that contradicts itself, or whose signature is broken, is refused.
    """
    from datetime import date

    from truearm.errors import InputError

    try:
        day = None if due is None else date.fromisoformat(due)
    except ValueError:
        raise InputError(f"expected a day after --due, got {due!r}", hint="--due 2027-11-03") from None
    with opened(folder) as found:
        n = found.add_certificates(files, due=day, trusted=trusted)
    print_line(f"{n} new in the registry. Next: truearm fleet status {folder}" if n else "Nothing is new.")


@fleet.command()
@options.with_shared
def check(
    context: Context,
    folder: Folder,
    serial_number: Annotated[str, Argument(metavar="SERIAL", help="Serial number of the arm.")],
    given: CheckOptions,
) -> None:
    """Check whether an arm is still as its model in force.

    The history of its checks is in the registry. As truearm check, which explains the options. Exit code 0: no need to
    recalibrate; 1: recalibrate; 3: undecided (repeat the check), or not enough checks.
    """
    from truearm.wings.laboratory.verbs.check import withdraw_check

    with opened(folder) as found:

        def withdraw(which: str, *, reason: str) -> WithdrawalResult:
            return withdraw_check(found.model(serial_number), found.history(serial_number), which, reason=reason)

        usage = "truearm fleet check FOLDER SERIAL SESSION"
        given.run(context, usage, partial(found.check, serial_number), withdraw)


@fleet.command()
def run(
    folder: Folder,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    prior: options.PriorFile = None,
    verify: Verify = False,
    as_json: options.Json = False,
) -> None:
    """Fit every arm of which something changed.

    That is its readings, drawing, kind of model, or type prior. What is fitted already is not fitted again, and an
    interrupted run is continued by the same command. A --prior is in force from now on; its own arms get that of the
    others. One arm's failure stops no other; a failed or worse fit replaces
    no model in force. Results are the same whoever computes. Exit code 1: some arms failed, now or before.
    """
    from truearm.solve.executors import chosen_executor

    executor = chosen_executor(workers, scheduler)
    with opened(folder) as found, progress(f"fitting {folder.name}") as update:
        result = found.run(executor, prior=prior, verify=verify, progress=update)
    print_record(result, as_json=as_json)
    raise Exit(1 if result.failures else 0)


@fleet.command()
def status(folder: Folder, verify: Verify = False, as_json: options.Json = False) -> None:
    """Print the state of every arm.

    First come arms for which something is to be done, then those whose constants differ most from before, or from those
    of their type.
    """
    with opened(folder) as found:
        print_record(found.status(verify=verify), as_json=as_json)


@fleet.command()
def report(folder: Folder, page: Annotated[Path, Option(help="Page to write, .html.")]) -> None:
    """Write a page of all arms, and one of each.

    The page of all arms is filtered as you type; those of the arms stand in a folder beside it.
    """
    with opened(folder) as found, progress(f"writing {page.name}", total=found.n_arms) as update:
        n = found.write_pages(page, progress=update)
    print_line(f"page written to {page}, with {n} pages of arms beside it")


@fleet.command()
def prior(
    folder: Folder,
    out: Annotated[Path, Option(help="File to write, for truearm fit --prior.")],
    arm: options.ArmOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Learn what the arms of a type have in common.

    It is the prior of the next arm, which then needs fewer readings; --arm is the type, if the fleet has several. Mean
    and scatter of the constants come from the readings of all arms with a model in force. Each arm is held out and
    predicted from 10 and from 20 of its readings; the file is written only if the others help. Exit code 1: they do
    not, and nothing is written.
    """
    from truearm.solve.executors import chosen_executor

    check_new_output(out, force=force)
    executor = chosen_executor(workers, scheduler)
    with opened(folder) as found, progress(f"learning from {folder.name}") as update:
        learned = found.type_prior(arm, executor=executor, progress=update)
        if learned.helps:
            learned.save(out)
    print_record(learned, as_json=as_json, files={"prior": out if learned.helps else None})
    raise Exit(0 if learned.helps else 1)
