"""Simulate: readings of a virtual arm, whose errors are known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from math import radians
from pathlib import Path
from typing import Any

import numpy as np

from truearm.arm import Arm
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.identification.planning.candidates import bar_places
from truearm.identification.planning.sampling import STRATEGIES, Poses, seat
from truearm.identification.planning.sampling.measuring import describe_rejections
from truearm.identification.virtual import Measurement, VirtualArm, load_preset
from truearm.identification.virtual.arm import measure_distances, place_anchors
from truearm.readings import Lengths, PointErrors, Session, write_lengths, write_session
from truearm.solve.threads import one_blas_thread
from truearm.workflows.inputs import ArmLike, to_arm
from truearm.workflows.record import Record, to_plain
from truearm.workflows.sentences import number_of

# Standard uncertainty that the certificate of a bar states for its length [mm].
BAR_U_MM = 0.005


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
        Number of readings.
    strategy : str
        Where the joints are: ``"box"`` (about the working pose), ``"sobol-box"``, ``"uniform"``, ``"sobol"``,
        ``"measuring"`` (everyday work) or ``"seat"`` (the tip in seats).
    preset : {"research", "shop", "worn", "perfect"}
        How large the errors of the arm are.
    seed : int
        Of the poses and the noise.
    arm_seed : int
        Of the arm's errors.
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
        taken = _poses_with_bars(nominal, strategy, poses, seed=seed, seats=seats, bars=bars, bar_mm=bar_mm)
    else:
        taken = _poses(nominal, strategy, poses, seed=seed, seats=seats, half_width_deg=half_width_deg)
    measured = virtual.measure(
        taken.angles, seed=seed, seat=taken.seat, seat_points=taken.seat_points, reference=reference
    )
    if anchors:
        places = place_anchors(anchors, reach=nominal.chain.reach)
        measured = measure_distances(measured, places, seed=seed)
    return SimulationResult(
        virtual=virtual,
        measurement=measured,
        lengths=_certificate(bars, bar_mm, seed=arm_seed) if bars else None,
        strategy=strategy,
        seed=seed,
        rejected=dict(taken.rejected),
        nominal_error=virtual.nominal_error(measured),
        noise_floor=None if measured.readings.points is None else virtual.noise_floor(measured),
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

    def to_dict(self) -> dict[str, Any]:
        """See `Record.to_dict`."""
        plain: dict[str, Any] = to_plain(
            {
                "summary": self.summary(),
                "arm": self.virtual.nominal.name,
                "preset": self.virtual.preset.name,
                "arm_seed": self.virtual.seed,
                "strategy": self.strategy,
                "seed": self.seed,
                "n": len(self.measurement),
                "rejected": self.rejected,
                "nominal_error": self.nominal_error,
                "noise_floor": self.noise_floor,
            }
        )
        return plain


def _poses(arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, half_width_deg: float | None) -> Poses:
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


def _poses_with_bars(
    arm: Arm, strategy: str, n: int, *, seed: int, seats: int | None, bars: int, bar_mm: float
) -> Poses:
    """Poses in single seats and in both seats of a bar at its places, as many in each seat."""
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


def _certificate(bars: int, bar_mm: float, *, seed: int) -> Lengths:
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
