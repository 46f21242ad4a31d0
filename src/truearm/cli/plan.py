"""``truearm plan``: which readings to take next."""

from __future__ import annotations

import re
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from zipfile import is_zipfile

import typer

from truearm.cli.console import Json, check_page_path, print_json, print_line, print_table, progress, version_row

if TYPE_CHECKING:
    from truearm.arm import Arm
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.identification.planning.prior import Prior
    from truearm.identification.planning.proposal import CalibrationPlan
    from truearm.identification.planning.sampling import Sector
    from truearm.readings import Session

# Of a coordinate, where no model says how large it is [mm].
NOISE_MM = 0.02
# Poses a seat that are usual, and seats beyond which one rarely goes.
POSES_PER_SEAT, MOST_SEATS = 10, 10


def plan(
    arm: Annotated[
        str, typer.Argument(metavar="ARM|MODEL", help="A name from `truearm arms`, an arm, URDF or model file.")
    ],
    artefact: Annotated[
        Literal["seat", "bar", "tracker"], typer.Option("--artefact", help="What the readings are taken with.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Session file to fill in, .csv; must be new.")],
    poses: Annotated[int, typer.Option("--poses", min=1, max=500, help="Number of readings.")] = 50,
    page: Annotated[Path | None, typer.Option("--page", help="Page with pictures to write, .html.")] = None,
    seats: Annotated[
        int | None,
        typer.Option("--seats", min=1, max=200, help="Seats, or places of the bar; by default ten poses a seat."),
    ] = None,
    length: Annotated[float | None, typer.Option("--length", help="Of the bar, between its seats [mm].")] = None,
    noise: Annotated[
        float | None,
        typer.Option("--noise", help="Standard deviation of a coordinate [mm]; by default the model's, else 0.02."),
    ] = None,
    strategy: Annotated[
        Literal["i-optimal", "d-optimal", "technician", "random"],
        typer.Option("--strategy", help="By which to choose the poses to write."),
    ] = "i-optimal",
    terms: Annotated[
        Literal["physical", "constants"] | None,
        typer.Option("--terms", help="What to find out of an arm; by default physical. A model has its own."),
    ] = None,
    taken: Annotated[
        Path | None, typer.Option("--taken", help="Session of readings taken already, that the model has not seen.")
    ] = None,
    volume: Annotated[
        str | None,
        typer.Option(
            "--volume",
            help="Where the arm is to be used: NEAR,FAR,LOW,HIGH [mm] from its shoulder and HALF_ANGLE [deg].",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all that is drawn.")] = 0,
    as_json: Json = False,
) -> None:
    """Plan the readings that tell most of an arm.

    Written is a session file with the angles to aim at in columns of notes; fill in what the encoders read (and, with a
    tracker, the point) and hand it to truearm fit. For a bar its lengths are written too, beside it.

    i-optimal: least uncertainty of a point in the volume. d-optimal: parameters known best, whatever they are good for.
    technician: poses as of a person who measures parts. random: poses drawn. All four are compared.

    With a model instead of an arm: the next poses after those it learned from.
    """
    from truearm.errors import InputError
    from truearm.identification.planning.proposal import STRATEGIES, Artefact, propose
    from truearm.identification.planning.template import (
        check_template_path,
        continue_seat_numbers,
        write_bar_lengths,
        write_template,
    )

    check_template_path(out)
    lengths = out.with_name(f"{out.stem}-lengths.csv") if artefact == "bar" else None
    if lengths is not None:
        check_template_path(lengths)
    if page is not None:
        check_page_path(page, Path(arm), *([] if taken is None else [taken]))
    held = Artefact(artefact, seats or (0 if artefact == "tracker" else usual_seats(artefact, poses)), length)
    with progress("planning", total=len(STRATEGIES)) as tell:
        nominal, known, seats_before = _before(arm, noise=noise, terms=terms, taken=taken)
        planned = propose(
            nominal,
            known,
            held,
            poses,
            volume=None if volume is None else sector_of(volume, nominal),
            seed=seed,
            progress=tell,
        )
        if strategy not in planned.proposals:
            raise InputError(
                f"a technician's poses need five turning joints or more, which arm {nominal.name!r} has not",
                hint="--strategy i-optimal",
            )
        chosen = continue_seat_numbers(planned.proposals[strategy].poses, seats_before)
        result = _result(planned, strategy, out=out, lengths=lengths, page=page)
        if page is not None:
            from truearm.identification.planning.plan_page import plan_page
            from truearm.pages.html import write_page

            tell(len(STRATEGIES), "drawing the page")
            facts = _facts(planned, arm, taken=taken, seed=seed)
            write_page(plan_page(planned, strategy, chosen, facts=facts), page)
        if lengths is not None:
            write_bar_lengths(chosen, lengths)
        write_template(nominal, chosen, out)
    if as_json:
        print_json(result)
    else:
        _tell(result)


def usual_seats(artefact: str, poses: int) -> int:
    """Seats, or places of a bar with its two, for ten poses each."""
    each = POSES_PER_SEAT * (2 if artefact == "bar" else 1)
    return max(1, min(round(poses / each), MOST_SEATS))


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


def _before(
    arm: str, *, noise: float | None, terms: Literal["physical", "constants"] | None, taken: Path | None
) -> tuple[Arm, Prior, list[str]]:
    """The arm, what is known of it, and the names of seats that readings have been taken in."""
    from truearm.arm import load_arm
    from truearm.errors import InputError
    from truearm.identification.planning.prior import nominal_prior

    model = None
    if _is_model(arm):
        if terms is not None:
            raise InputError("--terms is for an arm as drawn; a model has its own", file=arm)
        model = _model(Path(arm))
        nominal, known = _of_model(model, noise)
        seats = [name for reference in model.fit_.references for name in reference.unknowns]
        seats = [found[1] for name in seats if (found := re.fullmatch(r"x of seat (.+) \[mm\]", name))]
    else:
        nominal, seats = load_arm(arm), []
        known = nominal_prior(nominal, terms=terms or "physical", noise_mm=NOISE_MM if noise is None else noise)
    if taken is None:
        return nominal, known, seats
    readings = _readings(taken, nominal)
    if model is not None and model.is_trained_on(readings):
        raise InputError("the model learned from these readings and knows what they told", file=taken)
    return nominal, known.after(readings), seats + ([] if readings.seat is None else readings.seat.tolist())


def _is_model(arm: str) -> bool:
    return Path(arm).is_file() and is_zipfile(arm)


def _model(path: Path) -> IdentifiedModel:
    from truearm.compensation.models.identified_model import IdentifiedModel
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError

    model = load_model(path)
    if not isinstance(model, IdentifiedModel):
        raise InputError(
            "a network has no terms to plan for", file=path, hint="a kinematic or physical model, or the arm's name"
        )
    return model


def _of_model(model: IdentifiedModel, noise: float | None) -> tuple[Arm, Prior]:
    """A model's arm, and what the model knows of it."""
    from truearm.identification.planning.prior import identified_prior
    from truearm.readings import Session

    return identified_prior(
        model.arm_,
        model.fit_,
        noise_mm=model.residual_std_ if noise is None else noise,
        state=lambda angles: model.state(Session(angles)),
    )


def _readings(session: Path, arm: Arm) -> Session:
    from truearm.readings import check_angles, read_session

    readings = read_session(session, n_joints=arm.n_joints)
    lower, upper = arm.limits.T
    check_angles(readings, joint_names=arm.joint_names, lower=lower, upper=upper, prismatic=arm.chain.prismatic)
    return readings


def _facts(planned: CalibrationPlan, name: str, *, taken: Path | None, seed: int) -> list[tuple[str, str]]:
    """What a page about a plan rests on."""
    from truearm.identification.planning.proposal import LENGTH_U_MM

    arm = planned.arm
    groups = ", ".join(dict.fromkeys(term.group for term in planned.prior.perturbed_chain.terms))
    rows = [
        ("arm", f"{arm.name}: {arm.title}. {arm.source}"),
        (
            "known before",
            f"the model {Path(name).name}" if _is_model(name) else "the arm as drawn, with the priors of its terms",
        ),
        ("groups of terms", groups),
        ("noise of a coordinate", f"{planned.prior.noise_mm:.4g} mm"),
        ("seed", str(seed)),
        version_row(),
    ]
    if taken is not None:
        rows.insert(2, ("readings taken since", taken.name))
    if planned.artefact.length_mm is not None:
        rows.insert(4, ("bar", f"{planned.artefact.length_mm:g} mm, standard uncertainty taken as {LENGTH_U_MM:g} mm"))
    return rows


def _result(
    planned: CalibrationPlan, strategy: str, *, out: Path, lengths: Path | None, page: Path | None
) -> dict[str, Any]:
    from truearm.identification.planning.limitations import limitations

    chosen = next(proposal for name, proposal in planned.proposals.items() if name == strategy)
    return {
        "session": str(out),
        "lengths": None if lengths is None else str(lengths),
        "page": None if page is None else str(page),
        "arm": planned.arm.name,
        "artefact": planned.artefact.kind,
        "strategy": strategy,
        "n": len(chosen.poses),
        "places": 0 if chosen.poses.place is None else len(set(chosen.poses.place.tolist())),
        "noise_mm": planned.prior.noise_mm,
        "before_mm": float(chosen.rms_mm[0]),
        "after_mm": float(chosen.rms_mm[-1]),
        "strategies": {
            name: {
                "after_mm": float(proposal.rms_mm[-1]),
                "course": {"n": proposal.counts.tolist(), "rms_mm": proposal.rms_mm.tolist()},
                **{f"o{i}": getattr(proposal.observability, f"o{i}") for i in range(1, 6)},
                "rank": proposal.observability.rank,
                "n_parameters": proposal.observability.n_parameters,
            }
            for name, proposal in planned.proposals.items()
        },
        "untold": limitations(planned, chosen),
    }


def _tell(result: dict[str, Any]) -> None:
    many = "s" * (result["places"] != 1)
    where = {
        "tracker": "under a tracker",
        "seat": f"in {result['places']} seat{many}",
        "bar": f"at {result['places']} place{many} of a bar",
    }[result["artefact"]]
    print_line(f"{result['session']}: {result['n']} pose{'s' * (result['n'] != 1)} {where} for {result['arm']}")
    for name, what in (("lengths", "the bar's lengths, for truearm fit --lengths"), ("page", "the plan with pictures")):
        if result[name] is not None:
            print_line(f"{result[name]}: {what}")
    apart = ", apart from the scale" if result["artefact"] == "seat" else ""
    print_line(
        f"uncertainty of a point in the volume, root mean square{apart}: {result['before_mm']:.4g} mm before, "
        f"{result['after_mm']:.4g} mm after (noise of a coordinate {result['noise_mm']:.4g} mm)"
    )
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
    print_line("These poses will not tell:")
    for phrase in result["untold"]:
        print_line(f"- {phrase}")
