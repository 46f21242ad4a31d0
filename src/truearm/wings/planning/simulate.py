"""`simulate`: readings of a virtual arm, whose errors are known; `rehearse`: those that a plan asks for.

Poses are by a sampling strategy, or in seats and at places of a bar, with its certificate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.readings import Lengths, PointErrors, Session, write_lengths, write_session
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ArmLike, to_arm
from truearm.verbs.record import Record, number_of
from truearm.wings.planning.designs.candidates import bar_places
from truearm.wings.planning.designs.planned_readings import Poses, read_planned
from truearm.wings.planning.designs.sampling import STRATEGIES, describe_rejections, seat
from truearm.wings.planning.virtual import Measurement, VirtualArm, load_preset
from truearm.wings.planning.virtual.arm import measure_distances, place_anchors
from truearm.wings.planning.virtual.rehearsal import carry_out, lengths_of, move_set_up

# Standard uncertainty that the certificate of a bar states for its length [mm].
BAR_U_MM = 0.005


def strategy_poses(
    arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, half_width_deg: float | None
) -> Poses:
    """Poses by the strategy of a name, with the number of seats or the half width of the box where it has them.

    Raises
    ------
    InputError
        If there is no such strategy, or a parameter does not apply to it.
    """
    if strategy not in STRATEGIES:
        close = get_close_matches(strategy, STRATEGIES, n=1)
        raise InputError(
            f"expected a strategy out of {', '.join(STRATEGIES)}, got {strategy!r}",
            hint=f"strategy {close[0]}" if close else None,
        )
    options: dict[str, Any] = {}
    if half_width_deg is not None:
        if not strategy.endswith("box"):
            raise InputError(f"a half width is for the strategies box and sobol-box, not for {strategy}")
        options["half_width"] = radians(half_width_deg)
    if seats is not None:
        if strategy != "seat":
            raise InputError(f"seats are for the strategy seat, not for {strategy}", hint="strategy seat")
        options["seats"] = seats
    return STRATEGIES[strategy](arm, n, seed=seed, **options)


def poses_with_bars(
    arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, bars: int, bar_mm: float
) -> Poses:
    """Poses in single seats and in both seats of a bar at its places, as many in each seat.

    Raises
    ------
    InputError
        If the strategy is another than seat, or there are fewer poses than seats.
    """
    if strategy != "seat":
        raise InputError(f"bars are for the strategy seat, not for {strategy}", hint="strategy seat")
    single = 3 if seats is None else seats
    each = n // (single + 2 * bars)
    if single < 1 or each < 1:
        raise InputError(f"expected at least one pose a seat, got {n} poses for {single} seats and {bars} bars")
    on_bars = bar_places(arm, bars, length_mm=bar_mm, poses=each, seed=seed)
    in_seats = seat(arm, n - len(on_bars.angles), seed=seed, seats=single)
    parts = (in_seats, on_bars)
    assert all(part.seat is not None and part.seat_points is not None for part in parts)
    return Poses(
        np.concatenate([part.angles for part in parts]),
        dict(Counter(in_seats.rejected) + Counter(on_bars.rejected)),
        np.concatenate([part.seat for part in parts if part.seat is not None]),
        np.concatenate([part.seat_points for part in parts if part.seat_points is not None]),
    )


def bar_certificate(bars: int, bar_mm: float, *, seed: int) -> Lengths:
    """What is stated for the length of the bar, the same at all its places; it does not expand."""
    stated = round(bar_mm + BAR_U_MM * np.random.default_rng([seed, *b"bar"]).standard_normal(), 4)
    ends = [np.array([f"B{place}{end}" for place in range(1, bars + 1)]) for end in "ab"]
    return Lengths(
        ends[0],
        ends[1],
        np.full(bars, stated),
        np.full(bars, BAR_U_MM),
        artefact=np.full(bars, f"bar {bar_mm:g}"),
        expansion_per_K=np.zeros(bars),
        u_expansion_per_K=np.zeros(bars),
    )


if TYPE_CHECKING:
    from truearm.wings.laboratory.verbs.verify import ArtefactsLike


@one_blas_thread()
def simulate(
    arm: ArmLike,
    *,
    poses: int = 200,
    strategy: str = "box",
    preset: str = "research",
    seed: int = 0,
    arm_seed: int = 0,
    reference: bool = True,
    half_width_deg: float | None = None,
    seats: int | None = None,
    bars: int = 0,
    bar_mm: float = 500.0,
    anchors: int = 0,
) -> SimulationResult:
    """Measure with a virtual arm, whose errors are known.

    Two sessions of one arm have the same `arm_seed` and different `seed`.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    poses : int
        Number of poses; a reading each, with anchors one for each anchor.
    strategy : str
        Where the joints are: ``"box"`` (about the working pose), ``"sobol-box"``, ``"uniform"``, ``"sobol"``,
        ``"measuring"`` (everyday work) or ``"seat"`` (the tip in seats).
    preset : {"research", "shop", "worn", "printed", "perfect"}
        How large the errors of the arm are: research, shop, worn, printed or perfect.
    seed : int
        Of the poses and the noise.
    arm_seed : int
        Seed of the arm's errors: same seed, same arm.
    reference : bool
        Whether a reference instrument measures the tip.
    half_width_deg : float, optional
        Half width of the box [deg], 20 by default; strategies box and sobol-box only.
    seats : int, optional
        Number of single seats, 3 by default; strategy seat only.
    bars : int
        Places of a bar with a seat at each end; strategy seat only.
    bar_mm : float
        Length of the bar from seat to seat [mm]. Its certificate has a standard uncertainty of 0.005 mm.
    anchors : int
        Number of fixed points around the arm. Each pose is read once for each, with the distance to it.

    Returns
    -------
    SimulationResult

    Raises
    ------
    InputError
        If options do not go together, or the arm cannot take enough poses.

    Examples
    --------
    >>> import truearm as ta
    >>> simulation = ta.simulate("ur10", poses=40, seed=1)
    >>> len(simulation.session)
    40
    """
    nominal, magnitudes = to_arm(arm), load_preset(preset)
    virtual = VirtualArm.draw(nominal, magnitudes, seed=arm_seed)
    if bars:
        taken = poses_with_bars(nominal, strategy, poses, seed=seed, seats=seats, bars=bars, bar_mm=bar_mm)
    else:
        taken = strategy_poses(nominal, strategy, poses, seed=seed, seats=seats, half_width_deg=half_width_deg)
    measured = virtual.measure(
        taken.angles, seed=seed, seat=taken.seat, seat_points=taken.seat_points, reference=reference
    )
    if anchors:
        places = place_anchors(anchors, reach=nominal.chain.reach)
        measured = measure_distances(measured, places, seed=seed)
    lengths = bar_certificate(bars, bar_mm, seed=arm_seed) if bars else None
    return SimulationResult.of(
        virtual, measured, lengths=lengths, strategy=strategy, seed=seed, rejected=dict(taken.rejected)
    )


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult(Record):
    """Readings of a virtual arm, and what nobody can know of a real one.

    Attributes
    ----------
    virtual : VirtualArm
        The arm with its true errors.
    measurement : Measurement
        The readings with the true angles and tips.
    lengths : Lengths or None
        What the certificate states for the bar at its places.
    strategy : str
    seed : int
    rejected : dict of str to int
        Poses that were drawn and could not be taken, by reason.
    nominal_error : PointErrors
        Errors of the nominal arm.
    noise_floor : PointErrors or None
        Errors that no model can reduce; None without reference points.

    Examples
    --------
    >>> import truearm as ta
    >>> simulation = ta.simulate("ur10", poses=10, strategy="seat", seats=2, reference=False)
    >>> simulation.session.seat.tolist()[::5]
    ['S1', 'S2']
    """

    virtual: VirtualArm
    measurement: Measurement
    lengths: Lengths | None
    strategy: str
    seed: int
    rejected: dict[str, int]
    nominal_error: PointErrors
    noise_floor: PointErrors | None

    @classmethod
    def of(
        cls,
        virtual: VirtualArm,
        measurement: Measurement,
        *,
        strategy: str,
        seed: int,
        lengths: Lengths | None = None,
        rejected: Mapping[str, int] | None = None,
        moved: bool = False,
    ) -> SimulationResult:
        """The result of a measurement, with its errors; `moved` where its points are not in the base frame."""
        has_floor = measurement.readings.points is not None and not moved
        return cls(
            virtual=virtual,
            measurement=measurement,
            lengths=lengths,
            strategy=strategy,
            seed=seed,
            rejected=dict(rejected or {}),
            nominal_error=virtual.nominal_error(measurement),
            noise_floor=virtual.noise_floor(measurement) if has_floor else None,
        )

    @property
    def session(self) -> Session:
        """The readings that a user of the arm gets."""
        return self.measurement.readings

    def save(self, path: str | Path, *, lengths: str | Path | None = None) -> None:
        """Write the session, and the lengths to a file of their own: both or none.

        Raises
        ------
        InputError
            If a file cannot be written, or `lengths` is given and there are none.
        """
        if lengths is None:
            write_session(self.session, path)
            return
        if self.lengths is None:
            raise InputError("there are no lengths to write: the simulation has no bars", hint="bars=2")
        with atomic_file(path) as beside:
            write_session(self.session, beside)
            write_lengths(self.lengths, lengths)

    def summary(self) -> str:
        """The answer in one sentence: the number of readings, and of which arm they are."""
        return (
            f"{number_of(len(self.measurement))} of virtual arm {self.virtual.nominal.name}, preset "
            f"{self.virtual.preset.name}, arm seed {self.virtual.seed}."
        )

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        yield from self.virtual.nominal.remarks
        if self.rejected:
            yield f"rejected poses: {describe_rejections(self.rejected)}"
        for label, errors in (("nominal error", self.nominal_error), ("noise floor", self.noise_floor)):
            if errors is not None:
                mean, largest = errors["mean_abs_coordinate_mm"], errors["max_abs_coordinate_mm"]
                yield f"{label} of a coordinate: mean {mean:.4f} mm, maximum {largest:.4f} mm"
        if self.lengths is not None:
            n = len(self.lengths)
            yield (
                f"length of the bar by its certificate: {self.lengths.length_mm[0]:.4f} mm, "
                f"u = {self.lengths.u_mm[0]:g} mm, at {n} place{'s' * (n > 1)}"
            )

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "arm": self.virtual.nominal.name,
            "preset": self.virtual.preset.name,
            "arm_seed": self.virtual.seed,
            **self._named("strategy", "seed"),
            "n": len(self.measurement),
            **self._named("rejected", "nominal_error", "noise_floor"),
        }


@one_blas_thread()
def rehearse(
    arm: ArmLike,
    plan: str | Path,
    *,
    preset: str = "research",
    seed: int = 0,
    arm_seed: int = 0,
    lengths: str | Path | None = None,
    moved: bool = False,
    artefacts: ArtefactsLike | None = None,
) -> SimulationResult:
    """Measure with a virtual arm what a plan of `plan` or the points of `operator_sheet` ask for.

    Seats, bar and sphere stand where the plan puts them, and the arm goes near the planned poses. What a person writes
    down at a real arm (angles, names of seats and places) is in the session. Of the points of a verification it has a
    reading for each point, in the order of the file.

    Parameters
    ----------
    arm : Arm, str or Path
        The nominal arm that the plan was made for: an `Arm`, a name of `list_arms`, or an arm file or URDF.
    plan : path
        File of the plan, of which columns that were filled in already are not read; or, with `artefacts`, the points to
        measure of a verification, written by `OperatorSheetResult.save_points`.
    preset : {"research", "shop", "worn", "printed", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of the noise, and of poses and artefacts of a verification; another one for another day.
    arm_seed : int
        Of the arm's errors and of the errors of a plan's certificates.
    lengths : path, optional
        Known lengths between seats; by default the file that `plan` wrote beside the plan, if there is one.
    moved : bool
        Whether the reference instrument stands elsewhere, to rehearse a `refit`; a plan with a tracker only.
    artefacts : Artefacts or path, optional
        Of the points of a verification: certificates of the artefacts; the virtual ones deviate within their
        uncertainty and are at 20 degC.

    Returns
    -------
    SimulationResult

    Raises
    ------
    InputError
        If the plan is of another arm, the file of lengths is of another plan, a plan with a bar has none, an artefact
        has no certificate, or the arm does not reach all points.

    Examples
    --------
    >>> import truearm as ta
    >>> _ = ta.plan("gao2017", "tracker", poses=4, terms="constants").save("plan.csv")
    >>> rehearsal = ta.rehearse("gao2017", "plan.csv", preset="shop")
    >>> len(rehearsal.session)
    4
    >>> plan = ta.load_verification_plan("asme-b89.4.22")
    >>> on_a_sphere = plan.model_copy(update={"single_point": None, "volumetric": None})
    >>> sheet = ta.operator_sheet(on_a_sphere)
    >>> sheet.save_points("points.csv")
    >>> len(ta.rehearse("measuring7", "points.csv", artefacts=sheet.sheet.artefacts, preset="shop").session)
    27
    """
    nominal = to_arm(arm)
    virtual = VirtualArm.draw(nominal, load_preset(preset), seed=arm_seed)
    if artefacts is not None:
        if lengths is not None or moved:
            raise InputError("lengths and moved are for a plan of readings, not for the points of a verification")
        from truearm.wings.laboratory.standards.points_form import read_planned_points
        from truearm.wings.laboratory.tasks.simulated_verification import rehearse_points
        from truearm.wings.laboratory.verbs.verify import to_artefacts

        measured = rehearse_points(virtual, read_planned_points(plan), to_artefacts(artefacts), seed=seed)
        return SimulationResult.of(virtual, measured, strategy=f"points of {Path(plan).name}", seed=seed)
    planned = read_planned(plan, nominal)
    known = lengths_of(planned, lengths)
    measured = carry_out(virtual, planned, seed=seed, lengths=known)
    if moved:
        measured = move_set_up(measured, seed=seed)
    return SimulationResult.of(
        virtual, measured, lengths=known, strategy=f"plan {planned.file.name}", seed=seed, moved=moved
    )
