"""The catalogue of terms: the known causes by which a real arm differs from its nominal model.

The prior standard deviations are start values of the evidence, of the size seen on industrial and measuring arms.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache

import numpy as np

from truearm.arm.arm import LinkMasses
from truearm.arm.chain import Chain
from truearm.errors import InputError
from truearm.identification.terms.basis import (
    AXES,
    Basis,
    Column,
    Constant,
    Direction,
    Formula,
    GravityTorque,
    Harmonics,
    PayloadTorque,
    Temperature,
)
from truearm.identification.terms.expression import Expression
from truearm.identification.terms.linear_axis import linear_axis
from truearm.identification.terms.links import link_vectors
from truearm.identification.terms.state import ArmState
from truearm.identification.terms.term import SkippedTerm, Term, bands, determined_orders, orders_name
from truearm.readings.readings import PAYLOAD
from truearm.typing import FloatArray

# Standard deviations in mm are those of an arm of this reach; others in proportion, so that an arm is identified alike
# whatever its size, and the unit of its lengths.
TYPICAL_REACH_MM = 1500.0
ANGLE_STD, LENGTH_STD = 3e-3, 3.0  # rad, mm: constants of an arm
LENGTHS = "lengths and offsets"  # the group
# Free parts have a prior too, wider than any workshop: on an arm with few joints a translation of the base may be
# equivalent to one of the tip, and then the prior decides.
FREE_BASE = (1.0, 1.0, 1.0, 1e4, 1e4, 1e4)  # rad, mm
FREE_TIP = 1e3  # mm
FREE_TOOL = 1.0  # rad

OWN_AXIS = 2  # rotation about z among a motion's six components
# Above 101, the ratio of the strain-wave gears common in robots: one period per turn of the wave generator.
HIGHEST_ORDER_OFFERED = 110
OWN_AXIS_STD = 2e-4  # rad
# Periods per turn that encoders with a power of two of grating lines or poles interpolate.
INTERPOLATION_ORDERS = (128, 256, 512)
INTERPOLATION_STD = 2e-5  # rad
WOBBLE_ORDERS = (1, 2)
WOBBLE_ANGLE_STD, WOBBLE_LENGTH_STD = 5e-4, 0.2  # rad, mm; at order 1
GRAVITY_STD = 2e-5  # rad/(N m); torques of assumed masses grow with the square of the reach, and this falls with it
JOINT_COMPLIANCE = "joint compliance"  # the group
PAYLOAD_COMPLIANCE = "compliance under the payload"
"""The group of `payload_terms`."""
# Joints and links of robots and measuring arms, as of the gravity terms with known masses [rad/(N m)].
COMPLIANCE_STD = 2e-5
JOINT_GAINS = "joint gains"  # the group
GAIN_STD = 1e-2  # servos and potentiometers of hobby arms have 0.5 to 3 %
GROWTH_STD = 2e-5  # 1/K: steel 1.2e-5, aluminium 2.3e-5, carbon fibre 1e-6; see `expansion_prior` for what follows
HYSTERESIS_STD = {"revolute": 5e-5, "prismatic": 0.02}  # rad, mm
COLUMN_STD = {"revolute": 1e-4, "prismatic": 0.05}  # rad, mm, by a column's spread

# Values of a function that differ by less, or by this share of the largest, are the same.
SAME_SHARE = 1e-9
# Cosines nearer to 1 are those of parallel axes.
ROUNDING = 1e-12


def constants(
    chain: Chain,
    *,
    free: tuple[str, ...] = ("base", "tip"),
    angle_std: float = ANGLE_STD,
    length_std: float | None = None,
) -> list[Term]:
    """Constant motions of all places: link lengths, link offsets, twists and joint offsets, base and tip.

    Constants that are equivalent to a motion of a free base or tip, for example a translation along the last joint's
    axis, keep their prior: readings determine only their combination with that motion, so that they must not influence
    the scale of the other lengths.

    Parameters
    ----------
    chain : Chain
    free : tuple of str
        Which of ``"base"`` and ``"tip"`` are unknown: their priors are wide and are not scaled.
    angle_std, length_std : float
        Prior standard deviation of the other rotations [rad] and translations [mm]; 0 omits them. By default the
        translations have 3 mm times `relative_size`.

    Raises
    ------
    InputError
        If `free` has another part than base and tip.
    """
    unknown = set(free) - {"base", "tip"}
    if unknown:
        raise InputError(f"expected free parts among ['base', 'tip'], got {sorted(unknown)}")
    length_std = LENGTH_STD * relative_size(chain) if length_std is None else length_std
    return list(_constants(chain, tuple(free), angle_std, length_std))


@lru_cache(maxsize=16)  # every step of an identification asks for those of its arm
def _constants(chain: Chain, free: tuple[str, ...], angle_std: float, length_std: float) -> tuple[Term, ...]:
    size, terms = relative_size(chain), []
    for place in range(chain.n_places):
        part = place_name(chain, place)
        for component in range(3 if part == "tip" else 0, 6):  # a rotation about the tip does not move it
            turns = component < 3
            name, direction = f"{part} {_component_name(component)}", _unit(component)
            if part in free:
                wide = FREE_BASE[component] if part == "base" else FREE_TIP
                std, group = wide if turns else wide * size, part
            else:
                std = angle_std if turns else length_std
                group = "joint offsets" if component == OWN_AXIS else "axis directions" if turns else LENGTHS
                if "base" in free and place == 1 and component in (OWN_AXIS, OWN_AXIS + 3):
                    group = "equivalent to a free base"
                if "tip" in free and not turns and place == chain.n_joints:
                    group = "equivalent to a free tip"
                if "tip" in free and not turns and 1 < place == chain.n_joints - 1:
                    name, direction, is_along = _along_last_axis(chain, component)
                    group = "equivalent to a free tip" if is_along else group
            if std != 0:
                learn = group in ("joint offsets", "axis directions", LENGTHS)
                terms.append(Term(name, place, direction, Constant(), group, std, learn=learn))
    return tuple(terms)


def _along_last_axis(chain: Chain, component: int) -> tuple[str, tuple[float, ...], bool]:
    """Name and direction of a translation at the last joint but one, and whether it is along the last joint's axis.

    The three axes of the place, turned the shortest way until one is along that axis: where the zero of a joint turns
    the place, they do not turn with it.
    """
    last = chain.n_joints
    axis = chain.fixed[last - 1, :3, 2]
    nearest = int(np.abs(axis).argmax())
    target = axis * np.sign(axis[nearest])
    cosine, sine = target[nearest], np.cross(np.eye(3)[nearest], target)
    cross = np.cross(np.eye(3), sine)  # rows are e x sine
    turn = np.eye(3) - cross + cross @ cross / (1 + cosine)  # e_nearest becomes the target (Rodrigues)
    is_along = component - 3 == nearest
    if cosine > 1 - ROUNDING:
        return f"J{last - 1} {_component_name(component)}", _unit(component), is_along
    name = f"J{last - 1} translation {'along' if is_along else 'across'} the axis of J{last}"
    name += "" if is_along else f", nearest {AXES[component - 3]}"
    return name, (0.0, 0.0, 0.0, *turn[component - 3].tolist()), is_along


def relative_size(chain: Chain) -> float:
    """Reach of an arm over `TYPICAL_REACH_MM`; 1 for a chain without any length."""
    return chain.reach / TYPICAL_REACH_MM or 1.0


def base_terms(chain: Chain) -> list[Term]:
    """The six motions of a free base."""
    return [term for term in constants(chain, free=("base",), angle_std=0.0, length_std=0.0) if term.place == 0]


def tool_rotation(chain: Chain) -> list[Term]:
    """Free rotation of the tool on the flange; only references of orientations need it."""
    tip = chain.n_places - 1
    return [
        Term(f"tip {_component_name(component)}", tip, _unit(component), Constant(), "tool", FREE_TOOL, learn=False)
        for component in range(3)
    ]


def own_axis(chain: Chain, joint: int, *, highest: int = HIGHEST_ORDER_OFFERED) -> list[Term]:
    """Angle error of a joint: rotation about its own axis by harmonics of its angle (encoder, gear).

    Orders form bands, 1 to 2, 3 to 4, 5 to 8 and so on. Each band is a group with its own scale, which the joints of an
    arm share as they are of one make. Together they are a Gaussian process on the circle whose spectrum is a staircase;
    the evidence of each band decides which orders remain. A prismatic joint has no such terms.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    highest : int
        Highest order.
    """
    return [_own_axis_band(joint, band, band) for band in bands(highest) if _is_revolute(chain, joint)]


def interpolation(chain: Chain, joint: int, orders: tuple[int, ...] = INTERPOLATION_ORDERS) -> list[Term]:
    """Rotation about a joint's own axis by the sub-divisional error of its encoder, one term for each order.

    An encoder counts the periods of its grating and interpolates between them, with an error that repeats with the
    period. Each order is a group, which the joints of an arm share. A prismatic joint has no such terms.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    orders : tuple of int
        Periods per turn.
    """
    if not _is_revolute(chain, joint):
        return []
    return [
        Term(
            f"J{joint} encoder interpolation, order {k}",
            joint,
            _unit(OWN_AXIS),
            Harmonics(joint, (k,)),
            f"encoder interpolation, order {k}",
            INTERPOLATION_STD,
        )
        for k in orders
    ]


def wobble(chain: Chain, joint: int, orders: tuple[int, ...] = WOBBLE_ORDERS) -> list[Term]:
    """Tilt and run-out of a joint: the five motions other than its own, by low harmonics of its angle.

    A prismatic joint has no such terms.
    """
    if not _is_revolute(chain, joint):
        return []
    terms = []
    for component in range(6):
        if component != OWN_AXIS:
            turns = component < 3
            std = WOBBLE_ANGLE_STD if turns else WOBBLE_LENGTH_STD * relative_size(chain)
            terms.append(
                Term(
                    f"J{joint} wobble, {_component_name(component)}",
                    joint,
                    _unit(component),
                    Harmonics(joint, orders),
                    f"wobble, {'rotations' if turns else 'translations'}",
                    tuple(std / k for k in orders for _ in range(2)),
                )
            )
    return terms


def gravity(chain: Chain, joint: int, *, links: LinkMasses | None = None) -> list[Term]:
    """Rotations of a joint by the gravity torque there: link bending and joint compliance.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1; 0 is the base, which tilts by the load of joint 1.
    links : LinkMasses, optional
        The masses by which the torques are computed. Without them the names of the terms state that uniform link
        masses are assumed.
    """
    if joint:
        _is_revolute(chain, joint)
    guess = "" if links is not None else " (uniform link masses assumed)"
    std = GRAVITY_STD if links is not None else GRAVITY_STD / relative_size(chain) ** 2
    return [
        Term(
            f"{place_name(chain, joint)} {_component_name(about)} by the gravity torque about {AXES[axis]}{guess}",
            joint,
            _unit(about),
            GravityTorque(joint, axis),
            JOINT_COMPLIANCE if about == axis == OWN_AXIS else "link bending",
            std,
        )
        for about in range(3)
        for axis in range(3)
    ]


def payload_terms(chain: Chain, *, from_kg: float = 0.0) -> list[Term]:
    """Rotations of the base and of every joint by the torque of a payload, each about the axis of the torque.

    The payload is a mass at the nominal tip. With known masses of the links the gravity terms have its torque too, and
    these terms are the difference between the compliance under the arm's own weight and under the payload (balancers
    carry the one and not the other).

    Parameters
    ----------
    chain : Chain
    from_kg : float
        Payload at which the terms are zero [kg].
    """
    return [
        Term(
            f"{f'J{joint}' if joint else 'base'} rotation about {AXES[axis]} by the payload",
            joint,
            tuple(float(component == axis) for component in range(6)),
            PayloadTorque(joint, axis, from_kg),
            PAYLOAD_COMPLIANCE,
            COMPLIANCE_STD,
        )
        for joint in range(chain.n_joints + 1)
        for axis in range(3)
    ]


def thermal(chain: Chain) -> list[Term]:
    """Thermal expansion of the stand and of every link along itself; the coefficient is in 1/K.

    The evidence does not scale it: materials are known (`truearm.identification.judgement.expansion_prior`).
    """
    return [
        Term(
            f"thermal expansion of {f'link {i}' if i else 'the stand'}",
            i,
            (0.0, 0.0, 0.0, *vector.tolist()),
            Temperature(i),
            "thermal expansion",
            GROWTH_STD,
            learn=False,
        )
        for i, vector in enumerate(link_vectors(chain))
        if vector.any()
    ]


def hysteresis(chain: Chain, joint: int) -> list[Term]:
    """Hysteresis: motion about, or along, a joint's own axis by its direction of movement (backlash, friction)."""
    component, how = _own_motion(chain, joint)
    name, group = f"J{joint} hysteresis", f"hysteresis, {how} joints"
    std = HYSTERESIS_STD[how] * (relative_size(chain) if how == "prismatic" else 1.0)
    return [Term(name, joint, _unit(component), Direction(joint), group, std)]


def gains(state: ArmState) -> list[Term]:
    """Turning joints whose angle is wrong in proportion, about the middle of what the readings have of it.

    They are offered where readings ask for them: see `truearm.identification.judgement.joint_signs`.
    """
    middles = np.round(state.joint_angles.mean(axis=0), 3).tolist()
    return [
        Term(
            f"J{joint} gain",
            joint,
            _unit(OWN_AXIS),
            Formula((Expression.angle(joint) - middle,)),
            JOINT_GAINS,
            GAIN_STD,
        )
        for joint, middle in enumerate(middles, start=1)
        if _is_revolute(state.chain, joint) and np.ptp(state.joint_angles[:, joint - 1]) > 0
    ]


def column(chain: Chain, joint: int, name: str, *, prior_std: float) -> list[Term]:
    """Motion about, or along, a joint's own axis in proportion to a column of the session, such as the joint's torque.

    Parameters
    ----------
    chain : Chain
    joint : int
        Counted from 1.
    name : str
        The column. It is a group of its own, as it may have any unit.
    prior_std : float
        [rad, or mm for a prismatic joint, per unit of the column].
    """
    component, _ = _own_motion(chain, joint)
    title = f"J{joint} {_component_name(component)} by {name}"
    return [Term(title, joint, _unit(component), Column(name), name, prior_std)]


def candidate_terms(
    state: ArmState, *, free: tuple[str, ...] = ("base", "tip"), highest: int = HIGHEST_ORDER_OFFERED
) -> tuple[list[Term], list[SkippedTerm]]:
    """List all terms that the readings can determine, and those that they cannot.

    A harmonic is skipped where the joint moved by less than a quarter of its period, or where the angles of the joint
    are half a period apart or more, so that it is indistinguishable from a lower order. A function that is the same at
    every reading is skipped as it is indistinguishable from a constant.

    Parameters
    ----------
    state : ArmState
        Of the training readings.
    free : tuple of str
        As in `constants`.
    highest : int
        Highest order of angle errors.

    Returns
    -------
    terms : list of Term
    skipped : list of SkippedTerm
    """
    chain, joints = state.chain, range(1, state.chain.n_joints + 1)
    skipped: list[SkippedTerm] = []
    terms = constants(chain, free=free)
    wobbles: list[Term] = []
    for joint in joints:
        if chain.is_prismatic[joint - 1]:
            skipped.append(SkippedTerm(f"J{joint} harmonics", f"J{joint} is prismatic"))
            if joint == 1:  # a rail, longer and straight to less than a slide of the arm itself
                of_rail = linear_axis(joint, state.angles[:, 0])
                wobbles += of_rail
                if not of_rail:
                    travel = f"J{joint} moved by only {np.ptp(state.angles[:, 0]):.3g} mm"
                    skipped.append(SkippedTerm(f"J{joint} linear axis", travel))
            continue
        orders, lost = determined_orders(joint, state.joint_angles[:, joint - 1], max(highest, *WOBBLE_ORDERS))
        skipped += lost
        for band in bands(highest):
            if kept := tuple(k for k in band if k in orders):
                terms.append(_own_axis_band(joint, kept, band))
        # Few sessions sample these densely enough; skipping them is not worth a message.
        fine, _ = determined_orders(joint, state.joint_angles[:, joint - 1], INTERPOLATION_ORDERS[-1])
        terms += interpolation(chain, joint, tuple(k for k in INTERPOLATION_ORDERS if k in fine))
        if kept := tuple(k for k in WOBBLE_ORDERS if k in orders):
            wobbles += wobble(chain, joint, kept)
    terms += wobbles
    candidates = [term for joint in range(chain.n_joints + 1) for term in gravity(chain, joint, links=state.links)]
    if state.temperature_degC is None:
        skipped.append(SkippedTerm("thermal expansion", "the readings have no temperature"))
    if state.directions is None:
        skipped.append(SkippedTerm("hysteresis", "the directions of movement are not known"))
    candidates += _by_stated_inputs(state, skipped)
    return terms + list(_varying(candidates, state, skipped)), skipped


def unlearned_terms(state: ArmState) -> list[tuple[Term, float]]:
    """Terms by a temperature, direction or load that is the same at all readings, and the value of their function.

    The readings show nothing of them, but they move the tip where that input differs. A direction that is nowhere
    known is not one of them: readings from both sides show hysteresis as scatter.

    Parameters
    ----------
    state : ArmState
        Of the training readings.

    Returns
    -------
    list of (Term, float)
        Terms of one coefficient each.
    """
    terms = [*_by_stated_inputs(state, []), *_payload_at_training(state)]
    varying = list(_varying(terms, state, []))
    found = [(term, float(term.basis.values(state)[0].mean())) for term in terms if term not in varying]
    return [(term, value) for term, value in found if value or not isinstance(term.basis, Direction)]


def _by_stated_inputs(state: ArmState, skipped: list[SkippedTerm]) -> Iterator[Term]:
    """Terms by the inputs that a session states beside the angles: temperature, directions, loads."""
    if state.temperature_degC is not None:
        yield from thermal(state.chain)
    if state.directions is not None:
        for joint in range(1, state.chain.n_joints + 1):
            yield from hysteresis(state.chain, joint)
    yield from _loads(state, skipped)
    if PAYLOAD in state.columns:
        if _varies(state.columns[PAYLOAD]):
            yield from payload_terms(state.chain)
        else:  # its torque is that of an unknown mass of the last link
            skipped.append(SkippedTerm(PAYLOAD, "it is constant in these readings"))


def _payload_at_training(state: ArmState) -> list[Term]:
    """Terms by the difference from a payload that is the same at all readings."""
    kg = state.columns.get(PAYLOAD)
    return [] if kg is None or _varies(kg) else payload_terms(state.chain, from_kg=float(kg.mean()))


def place_name(chain: Chain, place: int) -> str:
    """Name of a place: base, J1 to Jn, tip."""
    return "base" if place == 0 else "tip" if place == chain.n_joints + 1 else f"J{place}"


def _loads(state: ArmState, skipped: list[SkippedTerm]) -> Iterator[Term]:
    """Terms by the columns that are named after the load of a joint, ``load_2_Nm``."""
    for name, values in state.columns.items():
        if name == PAYLOAD:
            continue
        joint = int(found[1]) if (found := re.match(r"load_(\d{1,3})(?:_|$)", name)) else 0
        if not 1 <= joint <= state.chain.n_joints:
            skipped.append(SkippedTerm(name, "its name does not give a joint, as load_2_Nm does"))
            continue
        _, how = _own_motion(state.chain, joint)
        typical = float(np.std(values) if _varies(values) else np.abs(values).max(initial=0.0))
        if typical <= SAME_SHARE:  # zero throughout: nothing says how large a load is in this unit
            skipped.append(SkippedTerm(name, "it is zero in these readings"))
            continue
        std = COLUMN_STD[how] * (relative_size(state.chain) if how == "prismatic" else 1.0)
        yield from column(state.chain, joint, name, prior_std=std / typical)


def _varying(terms: Iterable[Term], state: ArmState, skipped: list[SkippedTerm]) -> Iterator[Term]:
    """The terms whose function changes from reading to reading."""
    varies: dict[Basis, bool] = {}
    for term in terms:
        if term.basis not in varies:
            varies[term.basis] = _varies(term.basis.values(state))
            if not varies[term.basis]:
                skipped.append(SkippedTerm(term.basis.labels()[0], "it is constant in these readings"))
        if varies[term.basis]:
            yield term


def _varies(values: FloatArray) -> bool:
    """Whether values differ by more than rounding."""
    return values.size > 0 and bool(np.ptp(values) > SAME_SHARE * max(1.0, float(np.abs(values).max())))


def _own_axis_band(joint: int, orders: tuple[int, ...], band: tuple[int, ...]) -> Term:
    name = f"J{joint} angle error, {orders_name(orders)}"
    group = f"angle error, {orders_name(band)}"
    return Term(name, joint, _unit(OWN_AXIS), Harmonics(joint, orders), group, OWN_AXIS_STD)


def _is_revolute(chain: Chain, joint: int) -> bool:
    """Whether a joint of the chain, counted from 1, is revolute."""
    if not 1 <= joint <= chain.n_joints:
        raise InputError(f"expected a joint from 1 to {chain.n_joints}, got {joint}")
    return not chain.is_prismatic[joint - 1]


def _own_motion(chain: Chain, joint: int) -> tuple[int, str]:
    """Component of the motion that the joint itself makes, and the type of the joint."""
    return (OWN_AXIS, "revolute") if _is_revolute(chain, joint) else (OWN_AXIS + 3, "prismatic")


def _unit(component: int) -> tuple[float, ...]:
    return tuple(float(i == component) for i in range(6))


def _component_name(component: int) -> str:
    return f"rotation about {AXES[component]}" if component < 3 else f"translation along {AXES[component - 3]}"
