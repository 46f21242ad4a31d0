"""``truearm plan``: which readings to take next."""

from __future__ import annotations

from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import is_zipfile

import typer

from truearm.cli.console import Json, check_page_path, print_json, print_line, print_table, progress, version_row

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.identification.planning.plan import SessionPlan
    from truearm.identification.planning.sampling import Sector


def plan(
    arm: Annotated[
        str, typer.Argument(metavar="ARM|MODEL", help="A name from `truearm arms`, an arm, URDF or model file.")
    ],
    artefact: Annotated[
        Literal["seat", "bar", "tracker"], typer.Option("--artefact", help="Artefact or instrument to measure with.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Session file to fill in, .csv; must be new.")],
    poses: Annotated[int, typer.Option("--poses", min=1, max=500, help="Number of readings.")] = 50,
    page: Annotated[Path | None, typer.Option("--page", help="Page with pictures to write, .html.")] = None,
    seats: Annotated[
        int | None,
        typer.Option("--seats", min=1, max=200, help="Seats, or places of the bar; by default ten poses per seat."),
    ] = None,
    length: Annotated[float | None, typer.Option("--length", help="Length of the bar between its seats [mm].")] = None,
    noise: Annotated[
        float | None,
        typer.Option("--noise", help="Standard deviation of a coordinate [mm]; by default the model's, else 0.02."),
    ] = None,
    strategy: Annotated[
        Literal["i-optimal", "d-optimal", "technician", "random"],
        typer.Option("--strategy", help="How the poses of the session are chosen."),
    ] = "i-optimal",
    terms: Annotated[
        Literal["physical", "constants"] | None,
        typer.Option("--terms", help="Terms to identify of a nominal arm; by default physical. A model has its own."),
    ] = None,
    taken: Annotated[
        Path | None, typer.Option("--taken", help="Session already measured that the model was not identified from.")
    ] = None,
    volume: Annotated[
        str | None,
        typer.Option(
            "--volume",
            help="Where the arm is to be used: NEAR,FAR,LOW,HIGH [mm] from its shoulder and HALF_ANGLE [deg].",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random choices.")] = 0,
    as_json: Json = False,
) -> None:
    """Plan the poses of a calibration session.

    The command writes a session file with the angles to aim at in columns of notes. Fill in what the encoders read (and,
    with a tracker, the point), then use it with truearm fit. For a bar it also writes the file of its lengths.

    i-optimal: smallest uncertainty of a point in the volume. d-optimal: smallest overall parameter uncertainty.
    technician: poses as a person chooses them who measures parts. random: random poses. All four are compared.

    With a model instead of an arm: the next poses after those that the model was identified from.
    """
    from truearm.errors import InputError
    from truearm.identification.planning.plan import plan_session, usual_places
    from truearm.identification.planning.proposal import STRATEGIES, Artefact
    from truearm.identification.planning.template import check_template_path, write_bar_lengths, write_template
    from truearm.readings import read_session

    check_template_path(out)
    lengths = out.with_name(f"{out.stem}-lengths.csv") if artefact == "bar" else None
    if lengths is not None:
        check_template_path(lengths)
    if page is not None:
        check_page_path(page, Path(arm), *([] if taken is None else [taken]))
    held = Artefact(artefact, usual_places(artefact, poses) if seats is None else seats, length)
    with progress("planning", total=len(STRATEGIES)) as tell:
        subject, nominal = _subject(arm)
        try:
            planned = plan_session(
                subject,
                held,
                poses,
                strategy=strategy,
                terms=terms,
                noise_mm=noise,
                measured=None if taken is None else read_session(taken, n_joints=nominal.n_joints),
                volume=None if volume is None else sector_of(volume, nominal),
                seed=seed,
                progress=tell,
            )
        except InputError as error:
            raise error.in_file(arm) if _is_model(arm) and error.file is None else error from None
        if page is not None:
            from truearm.identification.planning.plan_page import plan_page
            from truearm.pages.html import write_page

            tell(len(STRATEGIES), "drawing the page")
            write_page(plan_page(planned, facts=_facts(planned, arm, taken=taken, seed=seed)), page)
        if lengths is not None:
            write_bar_lengths(planned.poses, lengths)
        write_template(nominal, planned.poses, out)
    result = {
        "session": str(out),
        "lengths": None if lengths is None else str(lengths),
        "page": None if page is None else str(page),
        **planned.to_dict(),
    }
    if as_json:
        print_json(result)
    else:
        _tell(result)


def sector_of(text: str, arm: Arm) -> Sector:
    """The volume that --volume names."""
    from truearm.errors import InputError
    from truearm.identification.planning.sampling import Sector
    from truearm.identification.planning.sampling.workspace import stance

    try:
        near, far, low, high, half_angle = numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = [nan]
    if not (all(map(isfinite, numbers)) and 0 <= near < far and low < high and 0 < half_angle <= 180):
        raise InputError(
            f"--volume expects NEAR,FAR,LOW,HIGH in mm, each the smaller first, and HALF_ANGLE in deg, got {text!r}",
            hint="--volume 300,800,-200,400,60",
        )
    reach = stance(arm).reach_mm
    return Sector(near / reach, far / reach, low / reach, high / reach, half_angle)


def _subject(arm: str) -> tuple[Arm | IdentifiedModel, Arm]:
    """A nominal arm or a model to plan for, and its nominal arm."""
    from truearm.arm import load_arm

    if _is_model(arm):
        model = _model(Path(arm))
        return model, model.arm_
    nominal = load_arm(arm)
    return nominal, nominal


def _is_model(arm: str) -> bool:
    return Path(arm).is_file() and is_zipfile(arm)


def _model(path: Path) -> IdentifiedModel:
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError

    model = load_model(path)
    if not isinstance(model, IdentifiedModel):
        raise InputError(
            "a network has no terms to plan for", file=path, hint="use a kinematic or physical model, or the arm's name"
        )
    return model


def _facts(planned: SessionPlan, name: str, *, taken: Path | None, seed: int) -> list[tuple[str, str]]:
    """Inputs of a plan, for its page."""
    from truearm.identification.planning.proposal import LENGTH_U_MM

    arm, prior, artefact = planned.plan.arm, planned.plan.prior, planned.plan.artefact
    groups = ", ".join(dict.fromkeys(term.group for term in prior.perturbed_chain.terms))
    rows = [
        ("arm", f"{arm.name}: {arm.title}. {arm.source}"),
        ("prior knowledge", f"the model {Path(name).name}" if _is_model(name) else planned.known_before),
        ("groups of terms", groups),
        ("noise of a coordinate", f"{prior.noise_mm:.4g} mm"),
        ("seed", str(seed)),
        version_row(),
    ]
    if taken is not None:
        rows.insert(2, ("readings already taken", taken.name))
    if artefact.length_mm is not None:
        rows.insert(4, ("bar", f"{artefact.length_mm:g} mm, assumed standard uncertainty {LENGTH_U_MM:g} mm"))
    return rows


def _tell(result: dict[str, Any]) -> None:
    many = "s" * (result["places"] != 1)
    where = {
        "tracker": "with a tracker",
        "seat": f"in {result['places']} seat{many}",
        "bar": f"at {result['places']} place{many} of a bar",
    }[result["artefact"]]
    apart = ", apart from the scale" if result["artefact"] == "seat" else ""
    print_line(
        f"Uncertainty of a point in the volume after {result['n']} pose{'s' * (result['n'] != 1)} {where}: "
        f"{result['after_mm']:.4g} mm, before {result['before_mm']:.4g} mm (root mean square{apart}; noise of a "
        f"coordinate {result['noise_mm']:.4g} mm)"
    )
    for name, what in (
        ("session", "the session to fill in"),
        ("lengths", "the lengths of the bar, for truearm fit --lengths"),
        ("page", "the plan with figures"),
    ):
        if result[name] is not None:
            print_line(f"{result[name]}: {what}")
    for sentence in result["limitations"]:
        print_line(f"- {sentence}")
    rows = [
        [
            name,
            f"{row['after_mm']:.4g}",
            *(f"{row[f'o{i}']:.3g}" for i in range(1, 6)),
            f"{row['rank']} of {row['n_parameters']}",
            "written" if name == result["strategy"] else "",
        ]
        for name, row in result["strategies"].items()
    ]
    print_table(["strategy", "after [mm]", *(f"O{i}" for i in range(1, 6)), "rank", ""], rows)
