"""The terms by which virtual arms of a preset differ from their nominal arm, and the coefficients drawn for one arm.

The terms are those that identification fits (`truearm.identification.terms`), and a few that it never offers: ball
cages, deflection by the measuring force, bending of links by the weight that they carry, and wear.

Basis functions of the latter are here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from math import radians
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import factorial2

from truearm.arm import Arm, Chain
from truearm.arm.rigid_motions import cos_sin, cross_matrix
from truearm.errors import InputError
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import (
    ArmState,
    Basis,
    Column,
    GravityTorque,
    Harmonics,
    Term,
    constants,
    link_vectors,
)
from truearm.identification.terms.basis import AXES
from truearm.identification.terms.catalogue import gravity, hysteresis, thermal, wobble
from truearm.identification.terms.linear_axis import TravelHarmonics, linear_axis
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray, IntArray, NameArray
from truearm.wings.planning.virtual.presets import ARCSEC, Preset
from truearm.wings.planning.virtual.state import (
    base_motion_column,
    cage_phase_column,
    force_column,
    link_masses,
    radian_of,
    random_stream,
)


@dataclass(frozen=True)
class GravityForce(Basis):
    """A component of the weight outward of a joint, along the axes of the joint's place, at the nominal pose [N].

    Parameters
    ----------
    joint : int
        Counted from 1.
    axis : int
        0, 1, 2 for x, y, z.
    """

    joint: int
    axis: int

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"weight outward of J{self.joint} along {AXES[self.axis]}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) forces [N]."""
        return np.ascontiguousarray(state.gravity_loads.force_in_joint[None, :, self.joint - 1, self.axis])


@dataclass(frozen=True)
class CageHarmonics(Basis):
    """Cosine and sine of the angle of a joint's ball cage, which starts a session at a phase of its own.

    Parameters
    ----------
    joint : int
        Counted from 1.
    ratio : float
        Turns of the cage in a turn of the joint.
    """

    joint: int
    ratio: float

    def labels(self) -> tuple[str, ...]:
        """Two functions."""
        return (f"cos of the ball cage of J{self.joint}", f"sin of the ball cage of J{self.joint}")

    def values(self, state: ArmState) -> FloatArray:
        """(2, n) cosine and sine."""
        angle = self.ratio * state.angles[:, self.joint - 1] + state.columns[cage_phase_column(self.joint)]
        return np.stack(cos_sin(angle))


@dataclass(frozen=True)
class Spots(Basis):
    """Bumps of a joint's angle: Gaussians at centres evenly spaced around the turn.

    Parameters
    ----------
    joint : int
        Counted from 1.
    width_rad : float
        Standard deviation of a Gaussian [rad]. The centres are three widths apart.
    """

    joint: int
    width_rad: float

    @property
    def n_spots(self) -> int:
        """Number of centres."""
        return max(1, round(2 * np.pi / (3 * self.width_rad)))

    def labels(self) -> tuple[str, ...]:
        """One function for each centre."""
        return tuple(f"spot at {360 * k / self.n_spots:.4g} deg of J{self.joint}" for k in range(self.n_spots))

    def values(self, state: ArmState) -> FloatArray:
        """(n_spots, n) heights from 0 to 1."""
        centres = 2 * np.pi / self.n_spots * np.arange(self.n_spots)
        away = np.remainder(state.angles[:, self.joint - 1] - centres[:, None] + np.pi, 2 * np.pi) - np.pi
        return np.asarray(np.exp(-0.5 * (away / self.width_rad) ** 2))


@dataclass(frozen=True)
class GearErrors(Basis):
    """Errors of a gear's mesh: cosine, sine and two sawteeth of a multiple of a joint's angle, which may be no integer.

    Parameters
    ----------
    joint : int
        Counted from 1.
    ratio : float
        Periods in a turn of the joint.
    """

    joint: int
    ratio: float

    def labels(self) -> tuple[str, ...]:
        """Four functions."""
        return tuple(f"{what} {self.ratio:g} J{self.joint}" for what in ("cos", "sin", "sawtooth", "shifted sawtooth"))

    def values(self, state: ArmState) -> FloatArray:
        """(4, n) values from -1 to 1."""
        phase = self.ratio * state.angles[:, self.joint - 1]
        sawteeth = [np.remainder((phase + shift) / np.pi, 2.0) - 1.0 for shift in (0.0, np.pi / 2)]
        return np.stack([*cos_sin(phase), *sawteeth])


@dataclass(frozen=True)
class Slack(Basis):
    """Side of its slack on which a joint lies: the sign of the gravity torque about its axis, smooth where it is small.

    Parameters
    ----------
    joint : int
        Counted from 1.
    zone_Nm : float
        Torque that closes the gap to 76 % (tanh 1) [N m].
    """

    joint: int
    zone_Nm: float

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"side of the slack of J{self.joint}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) values from -1 to 1."""
        return np.asarray(np.tanh(state.gravity_torques[:, self.joint - 1, 2] / self.zone_Nm))[None]


@dataclass(frozen=True)
class CableDrag(Basis):
    """Torque of a cable that is led across a joint and the next one, and slips in its guides where it pulls strongly.

    A cable of unit length at the zeros of both joints (angles a, b [rad]) is stretched to ``s = sqrt(1 + a^2 + b^2 + a
    b)``. Its energy ``(s - 1)^2 / 2`` has the slope ``(s - 1) (a + b / 2) / s`` by a; slipping limits it as tanh does.

    Parameters
    ----------
    joint : int
        Counted from 1; the last joint of an arm has none.
    """

    joint: int

    def labels(self) -> tuple[str, ...]:
        """One function."""
        return (f"drag of the cable across J{self.joint} and J{self.joint + 1}",)

    def values(self, state: ArmState) -> FloatArray:
        """(1, n) values from -1 to 1."""
        a, b = state.angles[:, self.joint - 1], state.angles[:, self.joint]
        s = np.sqrt(1 + a**2 + b**2 + a * b)
        return np.asarray(np.tanh((s - 1) * (a + b / 2) / s))[None]


def beam(
    link_mm: FloatArray, *, own_share: float, bending_stiffness_Nm2: float, torsion_stiffness_Nm2: float
) -> FloatArray:
    """Motion at the start of a straight link that moves its far end as bending and torsion of the link do.

    Euler-Bernoulli beam, held at the start. With length L, direction u, torque M and weight F carried at the start, of
    which W is the link's own, spread evenly: slope ``(L M - L^2/2 u x (F - W) - L^2/3 u x W) / EI``, deflection
    ``(L^2/2 M - L^3/6 u x (F - W) - L^3/8 u x W) x u / EI``, twist ``L (u . M) u / GJ``.

    Parameters
    ----------
    link_mm : (3,) array
        From the joint to the link's far end, in the joint's frame [mm].
    own_share : float
        W / F.
    bending_stiffness_Nm2, torsion_stiffness_Nm2 : float
        E I and G J [N m^2]; infinite is stiff.

    Returns
    -------
    (6, 6) array
        Columns: torque [N m], force [N]; rows: rotation [rad], translation [mm].
    """
    length_m = float(np.linalg.norm(link_mm)) * 1e-3
    out = np.zeros((6, 6))
    if length_m == 0.0:
        return out
    u = np.asarray(link_mm, dtype=float) * 1e-3 / length_m
    across, cross_u = np.eye(3) - np.outer(u, u), cross_matrix(u)
    by_torque = length_m * across / bending_stiffness_Nm2
    by_force = -(length_m**2) * ((1 - own_share) / 2 + own_share / 3) * cross_u / bending_stiffness_Nm2
    out[:3, :3] = by_torque + length_m * np.outer(u, u) / torsion_stiffness_Nm2
    out[:3, 3:] = by_force
    # Deflection is a moment turned into a shift: v -> v x u.
    shift_by_torque = length_m**2 / 2 * across / bending_stiffness_Nm2
    shift_by_force = -(length_m**3) * ((1 - own_share) / 6 + own_share / 8) * cross_u / bending_stiffness_Nm2
    out[3:, :3] = -1e3 * cross_u @ shift_by_torque
    out[3:, 3:] = -1e3 * cross_u @ shift_by_force
    # The rotation about the joint already moves the far end by r x link: subtract that.
    out[3:] += cross_matrix(np.asarray(link_mm, dtype=float)) @ out[:3]
    return out


_OWN_AXIS = 2  # of a motion, rotation about z

GEOMETRY, ENCODERS, BEARINGS, COMPLIANCE, GROWTH, DEFLECTION, HYSTERESIS, CAGES = GROUPS = (
    "geometry",
    "encoders",
    "bearings",
    "compliance",
    "thermal expansion",
    "tip deflection",
    "hysteresis",
    "ball cages",
)
"""Groups of the terms that sound arms have too: each can be larger or smaller and leaves the others as they are."""

SPOTS, GEARS, SLACK, CABLES, BASE = WEAR_GROUPS = ("spots", "gears", "slack", "cable drag", "base motion")
"""Groups of the terms of a worn arm: identification never offers them, as no smooth function of one angle does."""

SLIDE_POSITIONS = 4  # that give a slide's errors three orders

_DAMAGE = 3  # power of the random numbers of spots, see `ErrorClass`


class DrawnTerm(NamedTuple):
    """A term, which numbers of a stream its coefficients take, and their mean and standard deviation."""

    term: Term
    numbers: tuple[int, ...]
    mean: float = 0.0
    std: float | None = None  # by default the term's


@dataclass(frozen=True, eq=False)
class ErrorClass:
    """Terms whose coefficients take the normal random numbers z of one stream: ``(mean + std t) exp(log_std z)``.

    Here ``t = z^power`` over its standard deviation, power odd: with 1 the coefficients are normal; with 3 most are
    small and a few are large, as damage is.
    """

    stream: str
    rows: tuple[DrawnTerm, ...]
    n_numbers: int
    log_std: float = 0.0
    power: int = 1

    def draw(self, seed: int) -> FloatArray:
        """Draw the coefficients of all terms."""
        if not self.rows:
            return np.zeros(0)
        z = random_stream("arm", seed, self.stream).standard_normal(self.n_numbers)[self._index]
        t = z**self.power / np.sqrt(factorial2(2 * self.power - 1))
        return np.asarray((self._mean + self._std * t) * np.exp(self.log_std * z))

    @cached_property
    def _index(self) -> IntArray:
        return np.concatenate([row.numbers for row in self.rows]).astype(np.intp)

    @cached_property
    def _mean(self) -> FloatArray:
        return np.concatenate([np.full(len(row.numbers), row.mean) for row in self.rows])

    @cached_property
    def _std(self) -> FloatArray:
        stds = [row.term.prior_std if row.std is None else row.std for row in self.rows]
        return np.concatenate([np.full(len(row.numbers), std) for row, std in zip(self.rows, stds, strict=True)])


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """A preset as terms of an arm, with the preset's magnitudes as standard deviations.

    Terms of magnitude zero are omitted.

    Attributes
    ----------
    perturbed_chain : PerturbedChain
        The nominal chain with the terms.
    classes : tuple of ErrorClass
        The same terms by the random numbers that their coefficients take.
    """

    perturbed_chain: PerturbedChain
    classes: tuple[ErrorClass, ...]

    @property
    def terms(self) -> tuple[Term, ...]:
        """All terms."""
        return self.perturbed_chain.terms

    def draw(self, seed: int) -> FloatArray:
        """Draw the coefficients of all terms, each class from a stream of its own."""
        return np.concatenate([np.zeros(0), *(one.draw(seed) for one in self.classes)])

    @cached_property
    def groups(self) -> NameArray:
        """Group of each coefficient."""
        return np.array([term.group for term in self.terms for _ in range(term.n_coefficients)], dtype=np.str_)


@lru_cache(maxsize=2)  # many arms of one preset are drawn in a row
def error_model(arm: Arm, preset: Preset) -> ErrorModel:
    """Return the terms by which virtual arms of a preset differ from a nominal arm."""
    chain, n = arm.chain, arm.n_joints
    classes = (
        ErrorClass("geometry", tuple(_geometry(chain, preset)), 6 * chain.n_places),
        ErrorClass("encoder", tuple(_encoder(chain, preset)), 6 * n),
        ErrorClass("bearing 1", tuple(_bearing(chain, preset, 1)), 12 * n),
        ErrorClass("bearing 2", tuple(_bearing(chain, preset, 2)), 12 * n),
        ErrorClass("stiffness", tuple(_compliance(arm, preset)), 2 * n, preset.stiffness_spread),
        ErrorClass("temperature", tuple(_growth(chain, preset)), n + 1),
        ErrorClass("tip", tuple(_deflection(chain, preset)), 1),
        ErrorClass("hysteresis", tuple(_hysteresis(chain, preset)), n),
        ErrorClass("slide", (slides := tuple(_slides(arm, preset))), sum(row.term.n_coefficients for row in slides)),
        ErrorClass("cage", tuple(_cage(chain, preset)), 12 * n),
        *wear_classes(chain, preset),
    )
    return ErrorModel(PerturbedChain(chain, tuple(row.term for one in classes for row in one.rows)), classes)


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """The errors that belong to one arm, the same in every reading.

    Attributes
    ----------
    model : ErrorModel
        Terms of the errors.
    coefficients : (n_coefficients,) array
        Of all terms [rad or mm per unit of the basis].
    lag_s : (n_joints + 1,) array
        Time constants of the temperatures of the stand and the links [s].
    """

    model: ErrorModel
    coefficients: FloatArray
    lag_s: FloatArray

    def of_group(self, group: str) -> FloatArray:
        """Coefficients of the terms of a group, in their order."""
        return np.asarray(self.coefficients[self.model.groups == group])

    def scaled(self, factors: Mapping[str, float]) -> SystematicErrors:
        """Multiply the coefficients of groups by factors."""
        coefficients = self.coefficients.copy()
        for group, factor in factors.items():
            coefficients[self.model.groups == group] *= factor
        return replace(self, coefficients=coefficients)

    def in_session(self, temperature_degC: float, cage_phase: FloatArray) -> FloatArray:
        """Coefficients in one session, for basis functions of an arm 1 K above 20 degC with its ball cages at zero.

        The functions are then the same for all arms and sessions. Expansion is proportional to the temperature, and
        ``a cos(q + p) + b sin(q + p) = (a cos p + b sin p) cos q + (b cos p - a sin p) sin q``.

        Parameters
        ----------
        temperature_degC : float
            Of the stand and all links [degC].
        cage_phase : (n_joints,) array
            Of the ball cages [rad].
        """
        coefficients = self.scaled({GROWTH: temperature_degC - REFERENCE_DEGC}).coefficients
        cages = self.model.groups == CAGES
        a, b = coefficients[cages].reshape(-1, 2).T
        phase = cage_phase[[term.place - 1 for term in self.model.terms if term.group == CAGES]]
        cos, sin = np.cos(phase), np.sin(phase)
        coefficients[cages] = np.column_stack([cos * a + sin * b, cos * b - sin * a]).reshape(-1)
        return coefficients

    @property
    def geometry(self) -> FloatArray:
        """Constant motions at every place, (n_places, 6) [rad, mm]."""
        motions = np.zeros((self.model.perturbed_chain.chain.n_places, 6))
        motions[self._of_geometry] = self.of_group(GEOMETRY)
        return motions

    def with_geometry(self, motions: FloatArray) -> SystematicErrors:
        """Replace the geometry by motions (n_places, 6) [rad, mm].

        Raises
        ------
        InputError
            If the preset has no terms for some of them.
        """
        coefficients = self.coefficients.copy()
        coefficients[self.model.groups == GEOMETRY] = motions[self._of_geometry]
        changed = replace(self, coefficients=coefficients)
        if (changed.geometry != motions).any():
            raise InputError("the preset has no terms for some motions of this geometry")
        return changed

    @property
    def _of_geometry(self) -> tuple[list[int], list[int]]:
        """Places and components of the terms of the geometry."""
        terms = [term for term in self.model.terms if term.group == GEOMETRY]
        return [term.place for term in terms], [component_of(term) for term in terms]


def draw_systematic_errors(arm: Arm, preset: Preset, *, seed: int) -> SystematicErrors:
    """Draw an arm's systematic errors.

    Each class of errors has its own stream of random numbers: changing the magnitude of one class leaves the others.
    """
    model = error_model(arm, preset)
    temperature = random_stream("arm", seed, "temperature")
    temperature.standard_normal(arm.n_joints + 1)  # the coefficients of thermal expansion
    return SystematicErrors(model, model.draw(seed), preset.lag_s * temperature.uniform(0.5, 1.5, arm.n_joints + 1))


def draw_geometry(chain: Chain, preset: Preset, stream: np.random.Generator) -> FloatArray:
    """Draw a constant motion at every place, (n_places, 6) [rad, mm]. The tip only shifts."""
    motions = stream.standard_normal((chain.n_places, 6))
    motions[:, :3] *= np.radians(preset.angle_std_deg)
    motions[:, 3:] *= preset.length_std_mm
    motions[-1, :3] = 0.0
    return motions


def _unit(component: int) -> tuple[float, ...]:
    return tuple(float(other == component) for other in range(6))


def component_of(term: Term) -> int:
    """Which component of a motion a term with a unit direction moves."""
    return term.direction.index(1.0)


# The classes: each yields its terms of magnitudes above zero.


def _geometry(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    angle_std, length_std = np.radians(preset.angle_std_deg), preset.length_std_mm
    zero_std = float(np.hypot(angle_std, np.radians(preset.zero_std_deg)))
    for term in constants(chain, free=(), angle_std=zero_std, length_std=length_std):
        component = component_of(term)
        is_zero = component == _OWN_AXIS and 0 < term.place <= chain.n_joints and not chain.is_prismatic[term.place - 1]
        if component > _OWN_AXIS or is_zero or angle_std > 0:
            std = zero_std if is_zero else angle_std if component <= _OWN_AXIS else length_std
            yield DrawnTerm(replace(term, group=GEOMETRY, prior_std=std), (6 * term.place + component,))


def _encoder(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    stds = {
        1: float(eccentric_reading(preset.eccentricity_std_um, diameter_mm=preset.grating_diameter_mm)),
        2: preset.encoder_order2_std_arcsec * ARCSEC,
        4: preset.encoder_order4_std_arcsec * ARCSEC,
    }
    first = 0
    for joint, slides in enumerate(chain.is_prismatic.tolist(), start=1):
        for order, std in stds.items():
            if std > 0 and not slides:
                name = f"J{joint} encoder, order {order}"
                yield DrawnTerm(
                    Term(name, joint, _unit(_OWN_AXIS), Harmonics(joint, (order,)), ENCODERS, std), (first, first + 1)
                )
            first += 2


def _bearing(chain: Chain, preset: Preset, order: int) -> Iterator[DrawnTerm]:
    share = 1.0 if order == 1 else preset.bearing_order2_ratio
    tilt, runout = share * preset.bearing_tilt_std_arcsec * ARCSEC, share * preset.bearing_runout_std_um * 1e-3
    for row in _wobble(chain, (order,), tilt_std=tilt, runout_std=runout):
        yield row._replace(term=replace(row.term, group=BEARINGS))


def _cage(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    tilt, runout = preset.cage_tilt_std_arcsec * ARCSEC, preset.cage_runout_std_um * 1e-3
    for row in _wobble(chain, (1,), tilt_std=tilt, runout_std=runout):
        basis = CageHarmonics(row.term.place, preset.cage_ratio)
        name = row.term.name.replace("wobble", "ball cage")
        yield row._replace(term=replace(row.term, name=name, basis=basis, group=CAGES))


def _wobble(chain: Chain, orders: tuple[int, ...], *, tilt_std: float, runout_std: float) -> Iterator[DrawnTerm]:
    """Motions of all axes but the joint's own; numbers by joint, cosine and sine, and component."""
    for joint in range(1, chain.n_joints + 1):
        for term in wobble(chain, joint, orders):
            component = component_of(term)
            cosine = 12 * (joint - 1) + component
            if (std := tilt_std if component < 3 else runout_std) > 0:
                yield DrawnTerm(replace(term, prior_std=std), (cosine, cosine + 6))


def _compliance(arm: Arm, preset: Preset) -> Iterator[DrawnTerm]:
    """Compliance of each joint, and of the link after it as a beam held at the joint."""
    chain, masses = arm.chain, link_masses(arm, preset)
    tilt, drive = preset.joint_tilt_arcsec_per_Nm * ARCSEC, preset.joint_drive_arcsec_per_Nm * ARCSEC
    for joint, link_mm in enumerate(link_vectors(chain)[1:], start=1):
        about_same_axis = gravity(chain, joint, links=masses)[::4]  # as the torque
        for term, size in zip(about_same_axis, (tilt, tilt, drive), strict=True):
            if size > 0:
                yield DrawnTerm(replace(term, group=COMPLIANCE, prior_std=size), (2 * joint - 2,), size, 0.0)
        outward_kg = masses.mass_kg[joint - 1 :].sum()
        own_share = float(masses.mass_kg[joint - 1] / outward_kg) if outward_kg > 0 else 0.0
        for what, of_one in (("bending", (1.0, np.inf)), ("torsion", (np.inf, 1.0))):
            size = 1 / getattr(preset, f"link_{what}_stiffness_Nm2")
            by_load = beam(
                link_mm, own_share=own_share, bending_stiffness_Nm2=of_one[0], torsion_stiffness_Nm2=of_one[1]
            )
            for load, motion in enumerate(by_load.T):
                if motion.any() and size > 0:
                    basis = GravityTorque(joint, load) if load < 3 else GravityForce(joint, load - 3)
                    name = f"link {joint} {what} by {basis.labels()[0]}"
                    term = Term(name, joint, tuple(motion.tolist()), basis, COMPLIANCE, size)
                    yield DrawnTerm(term, (2 * joint - 1,), size, 0.0)


def _growth(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    mean, spread = preset.expansion_per_K, preset.expansion_spread_per_K
    for term in thermal(chain):
        if mean > 0 or spread > 0:
            term = replace(term, group=GROWTH, prior_std=float(np.hypot(mean, spread)))
            yield DrawnTerm(term, (term.place,), mean, spread)


def _deflection(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    mm_per_N = tip_compliance(preset)
    for axis in range(3 if mm_per_N > 0 else 0):
        name = f"tip deflection along {AXES[axis]}"
        term = Term(name, chain.n_places - 1, _unit(3 + axis), Column(force_column(axis)), DEFLECTION, mm_per_N)
        yield DrawnTerm(term, (0,), mm_per_N, 0.0)


def _hysteresis(chain: Chain, preset: Preset) -> Iterator[DrawnTerm]:
    std = preset.hysteresis_std_arcsec * ARCSEC
    for joint in range(1, chain.n_joints + 1 if std > 0 else 1):
        (term,) = hysteresis(chain, joint)
        own = std * float(radian_of(chain)[joint - 1])
        yield DrawnTerm(replace(term, group=HYSTERESIS, prior_std=own), (joint - 1,))


def _slides(arm: Arm, preset: Preset) -> Iterator[DrawnTerm]:
    """Slow errors along the travel of sliding joints: guides err as bearings do, their scales as gratings."""
    tilt, runout = preset.bearing_tilt_std_arcsec * ARCSEC, preset.bearing_runout_std_um * 1e-3
    stds, first = (tilt, tilt, tilt, runout, runout, preset.eccentricity_std_um * 1e-3), 0
    for joint in np.flatnonzero(arm.chain.is_prismatic & np.isfinite(arm.limits).all(axis=1)).tolist():
        lower, upper = arm.limits[joint]
        for term in linear_axis(joint + 1, np.linspace(lower, upper, SLIDE_POSITIONS)):
            std = stds[component_of(term)]
            if not isinstance(term.basis, TravelHarmonics) or std == 0:  # the scale of the arm is in its geometry
                continue
            by_function = tuple(std / k for k in term.basis.orders for _ in range(2))
            group = BEARINGS if component_of(term) < 5 else ENCODERS
            drawn = replace(term, group=group, prior_std=by_function)
            yield DrawnTerm(drawn, tuple(range(first, first + drawn.n_coefficients)))
            first += drawn.n_coefficients


def tip_compliance(preset: Preset) -> float:
    """Deflection of the tip by the measuring force [mm/N]."""
    return preset.tip_compliance_um_per_N * 1e-3


def eccentric_reading(eccentricity_um: npt.ArrayLike, *, diameter_mm: float) -> FloatArray:
    """Error of one read head on an eccentric grating [rad]: ``2 e / D``, or 412.5 e[um]/D[mm] arcsec."""
    return 2e-3 * np.asarray(eccentricity_um, dtype=float) / diameter_mm


def wear_classes(chain: Chain, preset: Preset) -> tuple[ErrorClass, ...]:
    """Classes of the errors of wear."""
    joints = [joint for joint in range(1, chain.n_joints + 1) if not chain.is_prismatic[joint - 1]]
    before_last = [joint for joint in joints if joint + 1 in joints]
    spots, gear = partial(Spots, width_rad=radians(preset.spot_width_deg)), partial(GearErrors, ratio=preset.gear_ratio)
    slack = partial(Slack, zone_Nm=preset.slack_zone_Nm)
    gear_spot, bearing_spot = preset.gear_spot_std_arcsec, preset.bearing_spot_std_arcsec
    base = tuple(_base(preset))
    return (
        _turns("gear spot", SPOTS, joints, spots, gear_spot, power=_DAMAGE),
        _turns("bearing spot x", SPOTS, joints, spots, bearing_spot, axis=0, power=_DAMAGE),
        _turns("bearing spot y", SPOTS, joints, spots, bearing_spot, axis=1, power=_DAMAGE),
        _turns("gear", GEARS, joints, gear, preset.gear_std_arcsec),
        _turns("slack", SLACK, joints, slack, preset.slack_std_arcsec),
        _turns("cable", CABLES, before_last, CableDrag, preset.cable_std_arcsec),
        ErrorClass("base motion", base, len(base)),
    )


def _turns(
    stream: str,
    group: str,
    joints: Iterable[int],
    basis: Callable[[int], Basis],
    std_arcsec: float,
    *,
    axis: int = _OWN_AXIS,
    power: int = 1,
) -> ErrorClass:
    """A class of rotations of joints, each coefficient with a number of its own."""
    rows, first = [], 0
    for joint in joints if std_arcsec > 0 else ():
        term = Term(f"J{joint} {stream}", joint, _unit(axis), basis(joint), group, std_arcsec * ARCSEC)
        rows.append(DrawnTerm(term, tuple(range(first, first + term.n_coefficients))))
        first += term.n_coefficients
    return ErrorClass(stream, tuple(rows), first, power=power)


def _base(preset: Preset) -> Iterator[DrawnTerm]:
    """Motion of the base, which the state of a session states in rad and mm."""
    turns = preset.base_creep_arcsec_per_sqrt_h > 0
    shifts = preset.base_creep_um_per_sqrt_h > 0 or preset.base_settling_um > 0
    for component in (*range(3 if turns else 0), *range(3, 6 if shifts else 3)):
        column = base_motion_column(component)
        yield DrawnTerm(Term(column, 0, _unit(component), Column(column), BASE, 1.0), (0,), mean=1.0, std=0.0)
