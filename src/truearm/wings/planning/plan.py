"""`plan`: which poses to measure next, so that an arm is identified best; `plan_check`: the routine of a check."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args
from zipfile import is_zipfile

from truearm.acceptance import acceptance_remarks, accepts
from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.atomic_write import check_new_file
from truearm.models import Compensator, IdentifiedModel, load_model
from truearm.models.identified_model import require_identified
from truearm.pages.drawings.page_record import PageRecord, arm_row, input_files, version_row
from truearm.readings import Session
from truearm.readings.columns import session_columns
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import SessionLike, to_arm, to_model_of_tip, to_session, within_limits
from truearm.verbs.record import TableRecord, TextTable
from truearm.wings.planning.designs import ArtefactKind, Strategy, Terms
from truearm.wings.planning.designs.candidates import Candidates
from truearm.wings.planning.designs.check_routine import CheckRoutine, check_routine
from truearm.wings.planning.designs.plan import SessionPlan, plan_session, usual_places
from truearm.wings.planning.designs.proposal import LENGTH_U_MM, Artefact, CalibrationPlan
from truearm.wings.planning.designs.template import lengths_path, write_bar_lengths, write_template
from truearm.wings.planning.designs.tour import mean_joint_move
from truearm.wings.planning.designs.workspace import sector_of, surroundings_of

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.pages.plotting import Figure


@dataclass(frozen=True, eq=False, repr=False)
class PlanResult(TableRecord, PageRecord):
    """Poses to measure next, and the uncertainty that they lead to.

    Attributes
    ----------
    session_plan : SessionPlan
        The poses of the chosen strategy, and the proposals of all strategies.
    session : str
        Name of the session that was measured already; empty if there is none.
    seed : int
        Seed of all random numbers.
    files : tuple of Path
        The files that were read.
    accepted : tuple of str
        What `accept` overrode, and what was accepted when the model was fitted.
    """

    session_plan: SessionPlan
    session: str
    seed: int
    files: tuple[Path, ...] = ()
    accepted: tuple[str, ...] = ()

    @property
    def plan(self) -> CalibrationPlan:
        """The proposals of all strategies, to compare."""
        return self.session_plan.plan

    @property
    def poses(self) -> Candidates:
        """The poses in the order of measuring; seats are numbered after those that have been measured already."""
        return self.session_plan.poses

    @property
    def limitations(self) -> tuple[str, ...]:
        """What these poses cannot determine."""
        return self.session_plan.limitations

    def save(self, path: str | Path, *, force: bool = False) -> tuple[Path, ...]:
        """Write the session file to fill in; for a bar, also the file of its lengths beside it.

        Parameters
        ----------
        path : path
            Ends in ``.csv``.
        force : bool
            Replace files that exist.

        Returns
        -------
        tuple of Path
            The files written.

        Raises
        ------
        InputError
            If a file is there already, or cannot be written.
        """
        files = template_files(path, self.plan.artefact.kind)
        for file in files:
            check_new_file(file, force=force, endings=(".csv",))
        for file in files[1:]:
            write_bar_lengths(self.poses, file)
        write_template(self.plan.arm, self.poses, path)
        return files

    def page(self) -> Page:
        """The plan with pictures of the places and of the joint angles."""
        from truearm.wings.planning.plan_page import plan_page

        return plan_page(self.session_plan, facts=self._facts())

    def figure(self) -> Figure:
        """Uncertainty in the volume against the number of poses."""
        from truearm.wings.planning.plan_page import course_figure

        return course_figure(self.plan.proposals)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        planned, n = self.session_plan, len(self.poses)
        plural = "s" * (planned.n_places != 1)
        where = {
            "tracker": "with a tracker",
            "seat": f"in {planned.n_places} seat{plural}",
            "bar": f"at {planned.n_places} place{plural} of a bar",
        }[self.plan.artefact.kind]
        without = ", without the scale" if self.plan.artefact.kind == "seat" else ""
        yield (
            f"Uncertainty of a point in the volume after {n} pose{'s' * (n != 1)} {where}: {planned.after_mm:.4g} mm, "
            f"before {planned.before_mm:.4g} mm (root mean square{without}; noise of a coordinate "
            f"{self.plan.prior.noise_mm:.4g} mm)"
        )
        yield _mean_move(degrees(planned.proposal.mean_move))
        for sentence in self.limitations:
            yield f"- {sentence}"
        yield from self.plan.arm.remarks
        yield from self.accepted
        numbers = ((name, one.rms_mm[-1], degrees(one.mean_move)) for name, one in self.plan.proposals.items())
        rows = ((name, f"{u:.4g}", f"{move:.0f}", "chosen" * (name == planned.strategy)) for name, u, move in numbers)
        yield TextTable(["strategy", "after [mm]", "move [deg]", ""], rows)

    def columns(self) -> dict[str, Any]:
        """The poses in the order of measuring, in the columns of a session file: angles to aim at, and seats."""
        poses = self.poses
        planned = Session(poses.angles, seat=poses.seat)
        return session_columns(planned, prismatic=self.plan.arm.chain.is_prismatic)

    def _json(self) -> object:
        return {**self.session_plan.to_dict(), "accepted": self.accepted}

    def _facts(self) -> list[tuple[str, str]]:
        arm, prior, length = self.plan.arm, self.plan.prior, self.plan.artefact.length_mm
        groups = ", ".join(dict.fromkeys(term.group for term in prior.perturbed_chain.terms))
        bar = f"{length} mm, standard uncertainty {LENGTH_U_MM:g} mm (assumed)"
        return [
            arm_row(arm),
            ("known before", self.session_plan.known_before),
            *([("session measured already", self.session)] if self.session else []),
            ("groups of terms", groups),
            *([("bar", bar)] if length is not None else []),
            ("noise of a coordinate", f"{prior.noise_mm:.4g} mm"),
            ("seed", str(self.seed)),
            *(("accepted", one) for one in self.accepted),
            version_row(),
        ]


@one_blas_thread()
@accepts
def plan(
    arm: Arm | Compensator | str | Path,
    artefact: ArtefactKind,
    *,
    poses: int = 50,
    seats: int | None = None,
    length_mm: float | None = None,
    noise_mm: float | None = None,
    strategy: Strategy = "i-optimal",
    terms: Terms | None = None,
    session: SessionLike | None = None,
    volume: Sequence[float] | None = None,
    table: Sequence[float] | None = None,
    avoid: Sequence[Sequence[float]] = (),
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
    accept: str | None = None,
) -> PlanResult:
    """Plan the poses that determine an arm best.

    Parameters
    ----------
    arm : Arm, identified model, str or path
        Name, arm file or URDF of an arm that nothing is measured of yet; or a model (file), to plan the poses that come
        next.
    artefact : {"seat", "bar", "tracker"}
        What the poses are measured with.
    poses : int
        Number of readings.
    seats : int, optional
        Number of seats, or of places of the bar; by default one for every ten poses.
    length_mm : float, optional
        Length of the bar, between its seats [mm].
    noise_mm : float, optional
        Standard deviation of a coordinate [mm]; by default that of the model, else 0.02.
    strategy : {"i-optimal", "d-optimal", "technician", "random"}
        ``i-optimal``: smallest uncertainty of a point in the volume. ``d-optimal``: smallest overall uncertainty of the
        parameters. ``technician``: poses as a person chooses them. ``random``: random poses. All four are compared.
    terms : {"physical", "constants"}, optional
        What is to be identified of an arm; by default physical. A model has its own terms.
    session : Session, DataFrame or path, optional
        Readings measured already that are not the training readings of the model.
    volume : five floats, optional
        Where the arm is to be used, seen from its shoulder: nearest and farthest horizontal distance [mm], lowest and
        highest height [mm], half angle to both sides of the front [deg].
    table : one or five floats, optional
        Where seats and bars can stand: height of the table above the base; with its extent x0, x1, y0, y1 in the base
        frame the arm may be beside it [mm]. By default the table carries the base too.
    avoid : sequence of six floats
        Boxes x0, x1, y0, y1, z0, z1 in the base frame in which neither arm nor artefact is in any pose [mm]; between
        poses nothing is checked.
    seed : int
        Seed of all random numbers.
    progress : callable, optional
        Called with the number of strategies done and a remark.
    accept : str, optional
        Why the readings of `session` are right where they would be refused as contradicted: the reason and what it
        overrode are said (docs/imperfect-readings.md).

    Returns
    -------
    PlanResult

    Raises
    ------
    InputError
        If the arm cannot be planned for, or cannot reach enough poses in the volume.

    Examples
    --------
    >>> import truearm as ta
    >>> plan = ta.plan("gao2017", "tracker", poses=4, terms="constants")
    >>> len(plan.poses), plan.session_plan.after_mm < plan.session_plan.before_mm
    (4, True)
    """
    if strategy not in get_args(Strategy):
        raise InputError(f"expected a strategy out of {', '.join(get_args(Strategy))}, got {strategy!r}")
    measured_with = Artefact(artefact, usual_places(artefact, poses) if seats is None else seats, length_mm)
    subject, source = arm_or_model(arm)
    nominal = subject if isinstance(subject, Arm) else subject.arm_
    measured, name = None, ""
    if session is not None:
        measured = within_limits(to_session(session, n_joints=nominal.n_joints), nominal).session
        name = measured.file.name if measured.file is not None else f"{len(measured)} readings"
    planned = plan_session(
        subject,
        measured_with,
        poses,
        strategy=strategy,
        terms=terms,
        noise_mm=noise_mm,
        measured=measured,
        volume=None if volume is None else sector_of(volume, nominal),
        surroundings=surroundings_of(table, avoid),
        seed=seed,
        progress=progress,
    )
    planned = replace(planned, known_before=source or planned.known_before)
    of_fit = () if isinstance(subject, Arm) else subject.doubts()
    said = (*acceptance_remarks(accept), *of_fit)
    return PlanResult(planned, name, seed, input_files(arm, session), said)


def template_files(path: str | Path, artefact: str) -> tuple[Path, ...]:
    """The files that `PlanResult.save` writes: the session to fill in and, for a bar, its lengths."""
    path = Path(path)
    return (path, lengths_path(path)) if artefact == "bar" else (path,)


def arm_or_model(arm: Arm | Compensator | str | Path) -> tuple[Arm | IdentifiedModel, str]:
    """What to plan for and, of a model, where it comes from."""
    if isinstance(arm, Compensator):
        model, file = arm, None
    elif isinstance(arm, str | Path) and Path(arm).is_file() and is_zipfile(arm):
        model, file = load_model(arm), Path(arm)
    else:
        return to_arm(arm), ""
    identified = require_identified(
        to_model_of_tip(model),
        "a model with a network has no terms to plan for",
        file=file,
        hint="use a kinematic or physical model, or the name of the arm",
    )
    return identified, f"a model of {model.n_train_} readings" if file is None else f"the model {file.name}"


@dataclass(frozen=True, eq=False, repr=False)
class CheckPlan(TableRecord):
    """The poses of an interim check.

    Attributes
    ----------
    routine : CheckRoutine
    """

    routine: CheckRoutine

    def save(self, path: str | Path, *, force: bool = False) -> tuple[Path, ...]:
        """Write the session to fill in and, with a bar, the file of its length beside it; see `CheckRoutine.save`."""
        return self.routine.save(path, force=force)

    @property
    def artefacts(self) -> tuple[str, ...]:
        """Seats and sphere, in the order of the routine."""
        names = [*self.routine.seat.tolist(), *self.routine.sphere.tolist()]
        return tuple(dict.fromkeys(name for name in names if name))

    def blocks(self) -> Iterator[str]:
        """See `Record`."""
        yield f"Interim check of {len(self.routine.angles)} readings: {', '.join(self.artefacts)}."
        yield _mean_move(self._mean_move_deg)

    def columns(self) -> dict[str, Any]:
        """The poses in the order of measuring, in the columns of a session file, with what to touch."""
        of = self.routine
        angles = session_columns(Session(of.angles), prismatic=of.arm.chain.is_prismatic)
        return {**angles, "seat": of.seat, "sphere": of.sphere, "instruction": of.notes}

    def _json(self) -> object:
        return {
            "arm": self.routine.arm.name,
            "n": len(self.routine.angles),
            "artefacts": self.artefacts,
            "mean_joint_move_deg": self._mean_move_deg,
        }

    @property
    def _mean_move_deg(self) -> float:
        return degrees(mean_joint_move(self.routine.arm, self.routine.angles))


@one_blas_thread()
def plan_check(
    arm: Arm | Compensator | str | Path,
    *,
    length_mm: float | None = None,
    sphere_mm: float | None = None,
    table: Sequence[float] | None = None,
    avoid: Sequence[Sequence[float]] = (),
    seed: int = 0,
) -> CheckPlan:
    """Plan an interim check: ten poses in a cone, four in each seat of a bar, nine points on a sphere.

    Parameters
    ----------
    arm : Arm, model, str or path
        Name, arm file or URDF of an arm, or its model (file).
    length_mm : float, optional
        Length of a bar between its seats [mm]; without it the check has no bar.
    sphere_mm : float, optional
        Diameter of a sphere [mm]; without it the check has no sphere.
    table, avoid
        As of `plan`.
    seed : int
        Seed of all random numbers.

    Returns
    -------
    CheckPlan

    Raises
    ------
    InputError
        If the arm does not reach an artefact.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.plan_check("measuring7", length_mm=400).artefacts
    ('cone', 'bar A', 'bar B')
    """
    subject, _ = arm_or_model(arm)
    nominal = subject if isinstance(subject, Arm) else subject.arm_
    around = surroundings_of(table, avoid)
    return CheckPlan(check_routine(nominal, length_mm=length_mm, sphere_mm=sphere_mm, surroundings=around, seed=seed))


def _mean_move(move_deg: float) -> str:
    return f"From pose to pose the joint that turns most turns by {move_deg:.0f} deg on average."
