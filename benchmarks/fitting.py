"""What fitted models do elsewhere: away from training, with a payload, on a rail, on another day, compared later."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import truearm as ta
from benchmarks.held_out import (
    IDENTIFIED,
    LEVEL,
    MODELS,
    mean_and_u,
    on_readings,
    split,
    squared_lengths,
    three_figures,
)
from benchmarks.rows import RowResult, Rows
from truearm.arm import load_arm
from truearm.arm.arm import LinkMasses
from truearm.arm.chain import Chain
from truearm.identification.terms import uniform_links
from truearm.identification.terms.links import link_vectors
from truearm.models import PhysicalModel
from truearm.models.identified_model import IdentifiedModel
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.importing import datasets
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import PRESETS, VirtualArm, load_preset

ROWS = Rows()

# The residual process -------------------------------------------------------------------------------------------------

VARIANTS = {"without": False, "with": True}


@ROWS.row("residual-process", quick={"seeds": 1})
def residual_process(sets: tuple[str, ...] = ("wam",), seeds: int = 10) -> RowResult:
    """Held-out errors, coverage and fit time with and without the residual process; sets wam, ur5, ur10-b, ur10-a.

    The others than wam take minutes a split.
    """
    table = []
    for name in sets:
        found: dict[str, list[dict[str, float]]] = {variant: [] for variant in VARIANTS}
        for seed in range(seeds):
            arm, train, test = split(name, seed)
            for variant, residual in VARIANTS.items():
                begun = time.process_time()
                model = PhysicalModel(arm, residual=residual).fit_readings(train)
                more = {"CPU [s]": time.process_time() - begun, "kept": float(model.residual_process_ is not None)}
                points, inside = on_readings(model, test)
                coverage = {"coverage [%]": 100 * float(inside.mean())}
                found[variant].append(three_figures(points, test.points) | coverage | more)
        for variant, each in found.items():
            means = {key: float(np.mean([one[key] for one in each])) for key in each[0]}
            table.append({"set": name, "residual process": variant, **means, "largest": max(e["max_mm"] for e in each)})
    return RowResult(table, notes=["Means over the splits; kept: share of splits in which the model has the process."])


# Away from training ---------------------------------------------------------------------------------------------------

JOINTS = (1, 4)


def halves(readings: Session) -> Iterator[tuple[str, Session, Session, Session]]:
    """Which half teaches; what it teaches, what is held out of it, and the other half."""
    for joint in JOINTS:
        angle = readings.angles[:, joint - 1]
        below = angle <= np.median(angle)
        for which, half in (("below", below), ("above", ~below)):
            teach, held_out = readings.rows(half).split(hold_out=0.15, seed=0)
            yield f"joint {joint} {which} {np.degrees(np.median(angle)):.0f} deg", teach, held_out, readings.rows(~half)


@ROWS.row("away-from-training", quick={"models": ("nominal",)})
def away_from_training(models: tuple[str, ...] = tuple(MODELS)) -> RowResult:
    """UR10 series B, learned from half the range of a joint, tested inside it and in the other half.

    15 % of the goal positions are held out of the teaching half, to compare with. Mean error [mm], median standard
    uncertainty of a coordinate [mm], share of the points in the 95 % ellipsoids, share of flagged poses.
    """
    table = []
    for name, teach, inside, away in halves(datasets.load_readings("ur10-b")):
        fitted = {label: MODELS[label](load_arm("ur10")).fit_readings(teach) for label in models}
        for where, test in (("inside", inside), ("away", away)):
            row = {"learned from": name, "tested": where}
            for label, model in fitted.items():
                points, covariance = model.predict_readings(test, return_cov=True)
                std = np.median(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))
                share = (squared_lengths(points, covariance, replace(test, point_std=None)) < LEVEL).mean()
                error = np.linalg.norm(points - test.points, axis=1).mean()
                flagged = model.outside_training(test.angles).mean()
                row[label] = f"{error:.2f}  {std:.3f}  {share:.0%}  {flagged:.0%}"
            table.append(row)
    return RowResult(table)


# Under a payload ------------------------------------------------------------------------------------------------------

NOISE_MM = 0.02
BEYOND_TIP_MM = np.array([0.0, 0.0, 40.0])
PAYLOADS = {"0 kg": (0.0,), "2 kg": (2.0,), "0 and 3 kg": (0.0, 3.0), "0 and 10 kg": (0.0, 10.0)}
TESTED_KG = (0.0, 5.0)
HEAVY = replace(
    PRESETS["research"],
    joint_drive_arcsec_per_Nm=2.5,
    joint_tilt_arcsec_per_Nm=0.8,
    reference_std_mm=NOISE_MM,
    nominal_mean_mm=0.0,
    nominal_max_mm=0.0,
)


def links_of(arm: ta.Arm) -> LinkMasses:
    """Links of 7 to 16 kg/m, their centres nearer to the base than the middle."""
    uniform = uniform_links(arm.chain, kg_per_m=12.0)
    return LinkMasses(uniform.mass_kg * [1, 1.3, 0.7, 1, 1.2, 0.8], 0.8 * uniform.centre_in_joint_mm)


def with_payload(virtual: ta.VirtualArm, kg: tuple[float, ...], n: int, *, seed: int) -> ta.Session:
    """Readings at uniform poses, the payloads by turns."""
    rng = np.random.default_rng(seed)
    arm, own = virtual.nominal, virtual.nominal.masses
    angles, payload = rng.uniform(-1.5, 1.5, (n, arm.n_joints)), np.resize(kg, n).astype(float)
    points: FloatArray = NOISE_MM * rng.standard_normal((n, 3))
    for one in np.unique(payload):
        mass, centre = own.mass_kg.copy(), own.centre_in_joint_mm.copy()
        held = link_vectors(arm.chain)[-1] + BEYOND_TIP_MM
        centre[-1] = (mass[-1] * centre[-1] + one * held) / (mass[-1] + one)
        mass[-1] += one
        rows = payload == one
        state = replace(virtual.resting(angles[rows]), links=LinkMasses(mass, centre))
        points[rows] += virtual.perturbed_chain.tips(state, virtual.systematic.coefficients)
    return ta.Session(angles, points, columns={"payload_kg": payload})


@ROWS.row("payload", quick={"readings": 60})
def payload(seed: int = 3, readings: int = 250) -> RowResult:
    """A virtual UR10 with flexible joints and heavy links: errors and stated uncertainties under a payload [mm].

    The arm has the errors of the preset `research` and compliances of a robot. The payload's centre of mass is 40 mm
    beyond the nominal tip, and of the links' masses identification knows nothing or all.
    """
    arm = ta.load_arm("ur10")
    known = replace(arm, masses=links_of(arm))
    virtual = ta.VirtualArm.draw(known, HEAVY, seed=seed)
    tests = {kg: with_payload(virtual, (kg,), 300, seed=100 + int(kg)) for kg in TESTED_KG}
    table = []
    for masses, nominal in (("unknown", arm), ("known", known)):
        for trained, kg in PAYLOADS.items():
            model = PhysicalModel(nominal).fit_readings(with_payload(virtual, kg, readings, seed=1))
            row = {"masses": masses, "trained at": trained}
            for tested, session in tests.items():
                row[f"mean at {tested:g} kg"], row[f"u at {tested:g} kg"] = mean_and_u(model, session)
            table.append(row)
    return RowResult(table)


# On a rail ------------------------------------------------------------------------------------------------------------

TRAVEL_MM = 4000.0
# Positions of the rail at which it was trained; None: anywhere.
TRAVELS = {"anywhere": None, "5 positions": np.linspace(0, TRAVEL_MM, 5), "one half": (0.0, TRAVEL_MM / 2)}


def arm_on_rail() -> ta.Arm:
    """The robot, its base carried along y."""
    robot = ta.load_arm("ur10")
    along_y = np.eye(4)
    along_y[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    fixed = np.concatenate([[along_y, along_y.T @ robot.chain.fixed[0]], robot.chain.fixed[1:]])
    return ta.Arm("rail", Chain(fixed, robot.chain.tip_in_flange, np.arange(7) == 0), joint_names=tuple("R123456"))


def rail_errors(travel_mm: FloatArray, n_places: int) -> FloatArray:
    """Motions of rail and arm, (n, n_places, 6) [rad, mm]."""
    u = travel_mm / TRAVEL_MM
    out = np.zeros((len(u), n_places, 6))
    out[:, 1, 0], out[:, 1, 1], out[:, 1, 2] = 2e-4 * np.sin(5 * u + 1), 6e-4 * (u - 0.5) ** 2, 1e-4 * np.cos(7 * u)
    out[:, 1, 3], out[:, 1, 4] = 0.3 * np.sin(4 * u), 0.2 * u**3
    out[:, 1, 5] = 3e-5 * (travel_mm - TRAVEL_MM / 2) + 0.05 * np.sin(9 * u)
    out[:, 3, :3], out[:, 5, 3:] = [1e-3, -5e-4, 2e-4], [0.3, 0.2, -0.4]
    return out


def on_rail(arm: ta.Arm, n: int, where: object, *, seed: int) -> ta.Session:
    """Readings at random poses; `where` as in `TRAVELS`."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-1.5, 1.5, (n, arm.n_joints))
    low, high = where if isinstance(where, tuple) else (0.0, TRAVEL_MM)
    angles[:, 0] = rng.choice(where, n) if isinstance(where, np.ndarray) else rng.uniform(low, high, n)
    tips = arm.chain.tip_in_base(angles, rail_errors(angles[:, 0], arm.chain.n_places))
    return ta.Session(angles, tips + [500.0, 300.0, 20.0] + rng.normal(0, NOISE_MM, (n, 3)))


@ROWS.row("rail", quick={"readings": 60})
def rail(readings: int = 250) -> RowResult:
    """A UR10 on a rail of 4 m with planted errors of rail and arm: mean error and uncertainty held out [mm]."""
    arm, table = arm_on_rail(), []
    test = on_rail(arm, 300, None, seed=9)
    for trained, where in TRAVELS.items():
        session = on_rail(arm, readings, where, seed=1)
        for label, kind in IDENTIFIED.items():
            error, u = mean_and_u(kind(arm).fit_readings(session), test)
            table.append({"trained": trained, "model": label, "mean": error, "u": u})
    return RowResult(table)


# On another day -------------------------------------------------------------------------------------------------------

DAYS, TESTED = (1, 2, 4), 600
# Days are numbered from 0, and none is the same in two arms.
SEEDS_A_DAY, LAST_DAY = 100_000, 999


def taken(virtual: VirtualArm, n_readings: int, n_days: int) -> Session:
    """Readings of some days in one set-up, at the poses of a person."""
    angles = np.array_split(measuring_poses(virtual.nominal, n_readings, seed=virtual.seed).angles, n_days)
    seed = virtual.seed
    days = [virtual.measure(poses, seed=seed + SEEDS_A_DAY * day).readings for day, poses in enumerate(angles)]
    names = ("angles", "points", "point_std", "temperature_degC", "directions")
    return Session(**{name: np.concatenate([getattr(day, name) for day in days]) for name in names})


def on_another_day(model: IdentifiedModel, virtual: VirtualArm) -> dict[str, float]:
    """Root mean square error and stated standard uncertainty of a coordinate [mm], and the share within 95 %."""
    seed = virtual.seed + SEEDS_A_DAY * LAST_DAY
    angles = measuring_poses(virtual.nominal, TESTED, seed=seed).angles
    angles = angles[~model.outside_training(angles)]
    day = virtual.measure(angles, seed=seed, temperature_degC=model.training_.temperature_degC.mean, reference=False)
    points, covariance = model.predict_readings(replace(day.readings, directions=None), return_cov=True)
    off, std = points - day.true_tips, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return {
        "rms_mm": float(np.sqrt((off**2).mean())),
        "stated_mm": float(np.sqrt((std**2).mean())),
        "in_95_percent": float((np.abs(off) < 1.96 * std).mean()),
    }


@ROWS.row("another-day", quick={"arms": 1})
def another_day(arms: int = 24, readings: int = 80, preset: str = "shop") -> RowResult:
    """Virtual arms learned from readings of one, two or four days, tested on another: error and uncertainty [mm].

    Each arm is measured at the poses of a person, as many readings in all, spread over the days in the same set-up.
    From one day to the next its ball cages start elsewhere, which no reading of a single day shows. The models then
    predict other poses, on a day from which they did not learn, at the mean temperature and with no word on directions
    of movement. Counted are coordinates within 1.96 stated standard uncertainties, where no joint is away from the
    training angles.
    """
    arm = load_arm("gao2017")
    found: dict[tuple[str, int], list[dict[str, float]]] = {(name, days): [] for name in IDENTIFIED for days in DAYS}
    for seed in range(arms):
        virtual = VirtualArm.draw(arm, load_preset(preset), seed=seed)
        for days in DAYS:
            session = taken(virtual, readings, days)
            for name, kind in IDENTIFIED.items():
                found[name, days].append(on_another_day(kind(arm).fit_readings(session), virtual))
    table = []
    for (name, days), each in found.items():
        rms, stated = (float(np.sqrt(np.mean([one[of] ** 2 for one in each]))) for of in ("rms_mm", "stated_mm"))
        share = np.array([one["in_95_percent"] for one in each])
        told = f"{share.mean():.1%} +- {share.std() / np.sqrt(len(share)):.1%}"
        table.append({"model": name, "days": days, "error, rms": rms, "stated, rms": stated, "within 95 %": told})
    return RowResult(table)


# Compared with a model of later readings ------------------------------------------------------------------------------


def with_offset(session: ta.Session, joint: int, offset_deg: float) -> ta.Session:
    """The readings of an arm whose joint offset (joint counted from 0) is larger."""
    angles = session.angles.copy()
    angles[:, joint] -= np.radians(offset_deg)
    return replace(session, angles=angles)


def judge(change: ta.ModelChange, joint: str, planted_deg: float) -> dict[str, float]:
    """Whether constants and tip count as changed, and how the planted offset was found."""
    (one,) = [c for c in change.constants if (c.place, c.name) == (joint, "theta")]
    found = {
        "constants": bool(change.changed),
        "tip": change.change.displacement.is_significant,
        "found": one.is_changed,
        "others": any((c.place, c.name) != (joint, "theta") for c in change.changed),
        "within_U": abs(np.degrees(one.change) - planted_deg) <= np.degrees(one.U),
        "U_deg": np.degrees(one.U),
        "n_constants": len(change.constants),
    }
    return {name: float(value) for name, value in found.items()}


@ROWS.row("compare", quick={"pairs": 1, "models": ("kinematic",)})
def compare(
    pairs: int = 40,
    arm: str = "gao2017",
    readings: int = 100,
    preset: str = "research",
    strategy: str = "box",
    offset: float = 0.1,
    models: tuple[str, ...] = tuple(IDENTIFIED),
) -> RowResult:
    """Does `compare` name what changed, and nothing else? Pairs of models of virtual arms from different readings.

    Each arm is measured twice at other poses. Of an unchanged arm the constants and the tip may count as changed in
    5 % of pairs each. Then the joint offset of one of the inner joints in turn is changed before the second session.
    """
    nominal = ta.load_arm(arm)
    common = {"poses": readings, "preset": preset, "strategy": strategy}
    found: dict[str, tuple[list[dict[str, float]], ...]] = {kind: ([], []) for kind in models}
    for pair in range(pairs):
        first, second = (ta.simulate(nominal, seed=2 * pair + 1 + k, arm_seed=pair, **common).session for k in range(2))
        joint = 1 + pair % (nominal.n_joints - 2)
        for kind, both in found.items():
            old = ta.fit(nominal, first, model=kind).model
            for each, change in zip(both, (0.0, offset), strict=True):
                new = ta.fit(nominal, with_offset(second, joint, change), model=kind).model
                each.append(judge(ta.compare(old, new), nominal.joint_names[joint], change))
    table = []
    for kind, both in found.items():
        still, moved = ({name: [one[name] for one in each] for name in each[0]} for each in both)
        counts = {"alarm": still["constants"], "tip alarm": still["tip"], "found": moved["found"]}
        counts |= {"within U": moved["within_U"], "others": moved["others"], "tip": moved["tip"]}
        medians = float(np.median(still["n_constants"])), float(np.median(moved["U_deg"]))
        sums = {name: sum(count) for name, count in counts.items()}
        table.append({"model": kind, "constants": medians[0], **sums, "U [deg]": medians[1]})
    return RowResult(table)


@ROWS.row("compare-ur10", quick={"models": ("kinematic",)})
def compare_ur10(models: tuple[str, ...] = tuple(IDENTIFIED)) -> RowResult:
    """Models of the published series A (2000 of its readings) and B of a UR10, which overlap in few poses."""
    first, second = (ta.fetch(name).session for name in ("ur10-a", "ur10-b"))
    rows = np.sort(np.random.default_rng(1).permutation(len(first))[:2000])
    notes = []
    for kind in models:
        old, new = (ta.fit("ur10", session, model=kind).model for session in (first.rows(rows), second))
        notes.append(f"{kind}\n{ta.compare(old, new)}")
    return RowResult(notes=notes)
