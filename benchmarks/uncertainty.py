"""Does the stated uncertainty hold? Features of parts, points of other days and far away, few readings, other tips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple, get_args

import numpy as np

import truearm as ta
from benchmarks.fitting import taken
from benchmarks.held_out import IDENTIFIED, LEVEL, squares
from benchmarks.rows import RowResult, Rows, Target, finding
from truearm.arm import Arm, load_arm
from truearm.arm.denavit_hartenberg import chain_from_dh
from truearm.choices import Conditions
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.missing_terms import missing_terms
from truearm.identification.terms import ArmState, constants
from truearm.models import PhysicalModel
from truearm.models.compensator import Compensator
from truearm.models.identified_model import IdentifiedModel
from truearm.models.refit import refit
from truearm.readings import Session
from truearm.typing import BoolArray, FloatArray
from truearm.wings.importing import datasets
from truearm.wings.laboratory import FeatureKind
from truearm.wings.laboratory.tasks.estimate import expanded_uncertainty
from truearm.wings.laboratory.tasks.feature_postures import feature_postures, middle_of, place_feature
from truearm.wings.laboratory.tasks.features import UP, Feature, circle, length_at, plane, sphere
from truearm.wings.laboratory.tasks.sampled_arms import PosteriorDistribution, PresetDistribution
from truearm.wings.laboratory.tasks.task import N_POSTURES, simulate_measurements
from truearm.wings.planning.designs.sampling import measuring_poses
from truearm.wings.planning.virtual import Measurement, VirtualArm, load_preset
from truearm.wings.planning.virtual.error_model import tip_compliance
from truearm.wings.planning.virtual.presets import Preset
from truearm.wings.planning.virtual.state import mean_hand_force

ROWS = Rows()
ARM = "gao2017"

# Features of parts ----------------------------------------------------------------------------------------------------

# Of these the intervals shall be no wider than needed, too.
TWO_POINTS = ("50 mm", "1 m")
AWAY = 0.2
# Poses for the truth are other ones than the task's.
SEED_OF_WAYS = 1_000_000


@dataclass(frozen=True)
class Trial:
    """Virtual arms of what preset, identified from how many readings by what model; by name, as processes load them."""

    arm: str
    preset: str
    readings: int
    days: int
    model: str

    def drawn(self, seed: int) -> tuple[VirtualArm, IdentifiedModel]:
        """A virtual arm and its model."""
        arm = load_arm(self.arm)
        virtual = VirtualArm.draw(arm, load_preset(self.preset), seed=seed)
        return virtual, IDENTIFIED[self.model](arm).fit_readings(taken(virtual, self.readings, self.days))

    def tasks(self, seed: int) -> dict[str, FloatArray]:
        """Measure and identify one arm; a row of numbers for each feature."""
        virtual, model = self.drawn(seed)
        found = {}
        for name, (feature, ways) in measured_on(self.arm).items():
            true = true_errors(virtual, model, feature, ways, seed=SEED_OF_WAYS + seed)
            stated = simulate_measurements(PosteriorDistribution(model), feature, seed=seed).estimates[0]
            low, high = stated.interval_mm
            inside = ((true >= low) & (true <= high)).mean()
            within = np.abs(true) <= stated.expanded_mm
            near = away_from(model, ways) < AWAY
            rms = np.sqrt((true**2).mean()), np.hypot(stated.u_mm, stated.bias_mm)
            found[name] = np.array([inside, within.mean(), near.sum(), (near & within).sum(), *rms, stated.expanded_mm])
        return found

    def measures(self, seed: int) -> dict[str, FloatArray]:
        """Errors, U and u (m, 3) [mm] of each feature, measured in several ways."""
        virtual, model = self.drawn(seed)
        found = {}
        for kind, feature in features_of(virtual.nominal).items():
            ways = feature_postures(virtual.nominal, feature, WAYS, seed=SEED_OF_WAYS)
            ways = ways[away_from(model, ways) < AWAY]
            rows = [measured(virtual, model, kind, feature, way, seed + 100 * i) for i, way in enumerate(ways)]
            found[kind] = np.reshape(rows, (-1, 3))
        return found


@cache
def measured_on(arm_name: str) -> dict[str, tuple[Feature, FloatArray]]:
    """The features where a person works, and the ways (m, k, n_joints) of holding each."""
    arm = load_arm(arm_name)
    middle, across = middle_of(arm)
    front = np.cross(across, UP)
    features = {
        "50 mm": length_at(middle, across, 50.0),
        "1 m": length_at(middle, across, 1000.0),
        "500 mm, 40 points": length_at(middle, across, 500.0, points=40),
        "ball 25 mm": sphere(middle, 25.0),
        "plate 200 mm, lying": plane(middle, UP, 200.0),
        "plate 200 mm, facing": plane(middle, front, 200.0),
    }
    return {
        name: (feature, feature_postures(arm, feature, N_POSTURES, seed=SEED_OF_WAYS))
        for name, feature in features.items()
    }


def coverage(name: str, share: float | None, side: str, limit: float) -> Target:
    """What a share over all arms shall come to."""
    return Target(f"coverage of {name} at {side}", share, limit, "above" if side == "least" else "below")


def true_errors(
    virtual: VirtualArm, model: Compensator, feature: Feature, ways: FloatArray, *, seed: int
) -> FloatArray:
    """Errors (m,) [mm] of what an arm measures and its model compensates, in m ways (m, k, n_joints)."""
    assert isinstance(model, IdentifiedModel)
    poses = ways.reshape(-1, ways.shape[2])
    touched = virtual.measure(poses, seed=seed, temperature_degC=model.training_.temperature_degC.mean, reference=False)
    untold = replace(touched.readings, directions=None)
    off = (model.predict_readings(untold) - touched.true_tips).reshape(-1, len(feature.points), 3)
    return np.array([feature.errors(feature.points + one)[0] for one in off])


def away_from(model: Compensator, ways: FloatArray) -> FloatArray:
    """Share (m,) of the poses of each way that are away from those that the model learned from."""
    return model.outside_training(ways.reshape(-1, ways.shape[2])).reshape(len(ways), -1).mean(axis=1)


@ROWS.row("tasks", quick={"arms": 1, "jobs": 1})
def tasks(
    arms: int = 500,
    first: int = 0,
    readings: int = 80,
    arm: str = ARM,
    preset: str = "shop",
    model: str = "kinematic",
    days: int = 1,
    jobs: int = 2,
) -> RowResult:
    """Task uncertainties: 95 % intervals of features against true errors of virtual arms.

    Each virtual arm is measured at random poses of a person, with a reference point at each, on one day or several, and
    identified. The model then states the uncertainty (`ta.task`, 1000 drawn arms) of lengths of two
    points, 50 mm and 1 m, of a length of forty points, a ball, a plate that lies and one that faces the arm; no
    repeatability is given. On a day of its own the virtual arm measures each in 40 ways of holding it, at the mean
    temperature of its readings, and its model, which is not told from which side its joints came, compensates. Counted
    is how often the error lies in the interval, and how often it is no larger than U: of a form, which errors make too
    large, that is what a decision rests on. The latter also of those ways alone of which less than a fifth of the poses
    are away from what the model learned from; of others the program says that it may be worse.
    """
    with ProcessPoolExecutor(jobs) as pool:
        work = Trial(arm, preset, readings, days, model).tasks
        found = list(pool.map(work, range(first, first + arms)))
    table, targets = [], []
    for name in found[0]:
        each = np.array([one[name] for one in found])
        # Over all near ways of all arms: some arm may have none.
        near = float(each[:, 3].sum() / each[:, 2].sum()) if each[:, 2].any() else None
        inside, within = (f"{one.mean():.3f} +- {one.std() / np.sqrt(len(one)):.3f}" for one in each[:, :2].T)
        row = {"feature": name, "in the interval": inside, "not above U": within, "of near ways": near}
        rms = np.sqrt((each[:, 4:] ** 2).mean(axis=0))
        names = ("error, rms [mm]", "stated, rms [mm]", "U, rms [mm]")
        table.append(row | dict(zip(names, rms.tolist(), strict=True)))
        if name in TWO_POINTS:  # of these the intervals shall be no wider than needed, too
            targets += [coverage(name, each[:, 0].mean(), *limit) for limit in (("least", 0.93), ("most", 0.97))]
        else:
            targets.append(coverage(name, near, "least", 0.93))
    return RowResult(table, targets, ["Shares with their standard errors between arms."])


SIZE_OF_BRUTE = 100.0


@ROWS.row("brute", quick={"arms": 100})
def brute(arms: int = 2000, arm: str = "measuring7", preset: str = "shop") -> RowResult:
    """U of a task with a preset against brute force: whole measurements by virtual arms, without the task's shortcuts.

    Each virtual arm of the preset measures all features once, in one session: `VirtualArm.measure` gives what its
    encoders read, with noise, hands, contact and temperature of the session, and its maker's program shows the tip of
    the nominal arm, the stylus qualified under the mean force. U of that is the 95 % quantile of the errors' sizes.
    """
    table, targets = [], []
    nominal, drawn_from = load_arm(arm), load_preset(preset)
    features = [place_feature(kind, SIZE_OF_BRUTE, nominal) for kind in get_args(FeatureKind)]
    stated = [simulate_measurements(PresetDistribution(nominal, drawn_from), one, n_arms=arms) for one in features]
    errors = brute_force_errors(features, [one.angles for one in stated], nominal, drawn_from, arms)
    for kind, feature, one, true in zip(get_args(FeatureKind), features, stated, errors, strict=True):
        expanded = one.estimates[0].expanded_mm
        ratio = expanded / float(expanded_uncertainty(true[None])[0])
        table.append({"feature": feature.name, "U [mm]": expanded, "U over brute force": ratio})
        for limit, side in ((0.85, "above"), (1.15, "below")):
            targets.append(Target(f"U of {kind} over brute force", ratio, limit, side))
    return RowResult(table, targets)


def brute_force_errors(
    features: Sequence[Feature], ways: Sequence[FloatArray], nominal: Arm, preset: Preset, arms: int
) -> FloatArray:
    """Errors (k, n) [mm] of the first quantity of k features, by n virtual arms with other seeds than a task's."""
    qualified = nominal.chain.with_tip(nominal.chain.tip_in_flange + tip_compliance(preset) * mean_hand_force(preset))
    points = np.concatenate([feature.points for feature in features])
    ends = np.cumsum([len(feature.points) for feature in features])[:-1]
    errors = []
    for seed in range(SEED_OF_WAYS, SEED_OF_WAYS + arms):
        virtual = VirtualArm.draw(nominal, preset, seed=seed)
        poses = np.concatenate([way[seed % len(way)] for way in ways])
        taken = virtual.measure(poses, seed=seed, seat_points=points, reference=False)
        shown = np.split(qualified.tip_in_base(taken.readings.angles), ends)
        errors.append([feature.errors(part)[0] for feature, part in zip(features, shown, strict=True)])
    return np.array(errors).T


# Measured features ----------------------------------------------------------------------------------------------------

WAYS = 6


def measured(
    virtual: VirtualArm, model: IdentifiedModel, kind: str, feature: Feature, way: FloatArray, seed: int
) -> list[float]:
    """Error, U and u [mm] of the first quantity of a feature; of a plate of the height of its middle."""
    touched = virtual.measure(
        way,
        seed=SEED_OF_WAYS + seed,
        seat_points=feature.points,
        temperature_degC=model.training_.temperature_degC.mean,
        reference=False,
    )
    half = len(feature.points) // 2
    names = np.array(["A"] * half + ["B"] * half) if kind == "length" else None
    session = replace(touched.readings, directions=None, seat=names)
    found = ta.measure(model, session, kind, n_arms=400, seed=seed).features[0]
    quantity = found.quantities[2 if kind == "plane" else 0]
    true = feature.points[:, 2].mean() if kind == "plane" else feature.quantities[0].nominal_mm
    return [quantity.value - true, quantity.expanded, quantity.u]


def features_of(arm: ta.Arm) -> dict[str, Feature]:
    """The features, in front of the arm."""
    middle, across = middle_of(arm)
    return {
        "length": length_at(middle, across, 500.0, points=10),
        "sphere": sphere(middle, 25.0),
        "plane": plane(middle, UP, 200.0),
        "circle": circle(middle, UP, 50.0),
    }


@ROWS.row("measure", quick={"arms": 1, "jobs": 1})
def measure(
    arms: int = 40, readings: int = 80, arm: str = ARM, preset: str = "shop", model: str = "kinematic", jobs: int = 2
) -> RowResult:
    """U of features that `measure` states against true errors of virtual arms.

    Each virtual arm is measured at random poses of a person, with a reference point at each, and identified. On another
    day it touches a ball, a bore, a plate and the two ends of a length, held in six ways; `truearm.measure` is given
    the joint angles alone. Counted is how often the error of the first quantity (of a plate the height of its middle)
    is no larger than U, of ways of which less than a fifth of the poses are outside the trained range.
    """
    with ProcessPoolExecutor(jobs) as pool:
        found = list(pool.map(Trial(arm, preset, readings, 1, model).measures, range(arms)))
    table, targets = [], []
    for kind in found[0]:
        each = np.concatenate([one[kind] for one in found])
        share = float((np.abs(each[:, 0]) <= each[:, 1]).mean())
        error, expanded, u = np.sqrt((each**2).mean(axis=0)).tolist()
        rms = {"error, rms [mm]": error, "u, rms [mm]": u, "U, rms [mm]": expanded}
        table.append({"feature": kind, "measured": len(each), "error not above U": share, **rms})
        targets.append(coverage(kind, share, "least", 0.93))
    return RowResult(table, targets)


# Points: the same day, another day, far from the training, few readings of real arms ---------------------------------

PRESETS = ("research", "shop", "worn")
TESTED, SUBSET = 300, 40
REPEATED, MOVED = "same day, u of repeatability", "another set-up, refitted"
# Readings of another day that a refit takes.
REFITTED = 20
# Seeds of poses and days that differ from those of the arms.
TRAIN, OTHER, DAY = 1000, 5000, 77_777


class Share(NamedTuple):
    """Points inside their ellipsoids, and which of them are flagged as outside the training."""

    inside: BoolArray
    flagged: BoolArray


def share_of(
    model: IdentifiedModel,
    readings: Session,
    truth: FloatArray,
    variance: float = 0.0,
    conditions: Conditions = "reproducibility",
) -> Share:
    """`variance` is that of a coordinate of `truth` [mm^2]."""
    model = model.under(conditions)
    points, covariance = model.predict_readings(readings, return_cov=True)
    inside = squares(points - truth, covariance + variance * np.eye(3)) < LEVEL
    return Share(inside, model.outside_training(readings))


@cache
def virtual_shares(preset: str, model: str, n: int, arms: int) -> dict[str, list[Share]]:
    """The tests of some arms."""
    arm = load_arm(ARM)
    names = REPEATED, MOVED, "another day", "same day", "uniform poses"
    found: dict[str, list[Share]] = {name: [] for name in names}
    for seed in range(arms):
        rng = np.random.default_rng(seed)
        virtual = VirtualArm.draw(arm, load_preset(preset), seed=seed)
        day = virtual.measure(measuring_poses(arm, n + TESTED, seed=TRAIN + seed).angles, seed=seed)
        order = rng.permutation(n + TESTED)
        learned, tested = np.sort(order[:n]), np.sort(order[n:])
        fitted = IDENTIFIED[model](arm).fit_readings(day.readings.rows(learned))
        later = virtual.measure(measuring_poses(arm, TESTED + REFITTED, seed=OTHER + seed).angles, seed=seed + DAY)
        moved = refit(fitted, later.readings.rows(np.arange(REFITTED)), free=("base", "tip"))
        others = np.arange(REFITTED, TESTED + REFITTED)
        lower, upper = np.clip(arm.limits.T, -np.pi, np.pi)
        uniform = virtual.measure(rng.uniform(lower, upper, (TESTED, arm.n_joints)), seed=seed)
        same = day.readings.rows(tested), day.true_tips[tested]
        found["same day"].append(share_of(fitted, *same))
        found[REPEATED].append(share_of(fitted, *same, conditions="repeatability"))
        on_it = later.readings.rows(others), later.true_tips[others]
        found["another day"].append(share_of(fitted, *on_it))
        found[MOVED].append(share_of(moved, *on_it, conditions="repeatability"))
        found["uniform poses"].append(share_of(fitted, uniform.readings, uniform.true_tips))
    return found


def of_subsets(name: str, repeats: int) -> tuple[FloatArray, float]:
    """Coverage of each subset of real readings, and the median size of the ellipsoids [mm]."""
    readings, arm = datasets.load_readings(name), load_arm(datasets.DATASETS[name].arm)
    rng, shares, sizes = np.random.default_rng(0), [], []
    for _ in range(repeats):
        learned = rng.permutation(len(readings))[:SUBSET]
        others = np.setdiff1d(np.arange(len(readings)), learned)
        if readings.position is not None:
            others = np.flatnonzero(~np.isin(readings.position, readings.position[learned]))
        test = readings.rows(rng.choice(others, TESTED, replace=False))
        model = PhysicalModel(arm).fit_readings(readings.rows(np.sort(learned)))
        variance = 0.0 if test.point_std is None else float((test.point_std**2).mean())
        shares.append(share_of(model, test, test.points, variance).inside.mean())
        covariance = model.predict_readings(test, return_cov=True)[1]
        sizes.append(float(np.median(np.linalg.det(covariance) ** (1 / 6))))
    return np.array(shares), float(np.median(sizes))


def judged(label: str, each: Sequence[Share], low: float, high: float, worst: float) -> dict[str, str]:
    """One row."""
    shares = np.array([one.inside.mean() for one in each])
    wanted = f"{low:.0%} to {high:.0%}" + (f", worst arm {worst:.0%}" if worst else "")
    now = f"{shares.mean():.1%}, worst arm {shares.min():.0%}"
    return finding(label, wanted, now, bool(low <= shares.mean() <= high and shares.min() >= worst))


@ROWS.row("points", quick={"arms": 1, "sizes": (50,), "subsets": 1})
def points(arms: int = 32, sizes: tuple[int, ...] = (50, 300, 2000), subsets: int = 50) -> Iterator[dict[str, str]]:
    """Points in their 95 % ellipsoids: the same day, another day, far from the training, few readings of real arms.

    Virtual arms gao2017 of every preset (six at most of 2000 readings) are measured at the poses of a person and
    identified. Some of the readings are kept for the test: the same day, with the u of that day (repeatability) and
    that of any day. On another day the ball cages start elsewhere
    and the air is at another temperature. Uniform poses lie outside the training, most of them. Real arms: 40 readings
    at random of UR10 series B and UR5, tested at positions that are not among them. Virtual arms: true tips.
    """
    for n in sizes:
        some = min(arms, 6) if n == 2000 else arms
        for preset in PRESETS:
            found = virtual_shares(preset, "physical", n, some)
            label = f"physical, {preset}, {n} readings, {some} arms"
            yield judged(f"{label}: {REPEATED}", found[REPEATED], 0.93, 0.97, 0.85)
            yield judged(f"{label}: same day, u of any day", found["same day"], 0.93, 1.0, 0.85)
            yield judged(f"{label}: another day", found["another day"], 0.92, 0.97, 0.0)
            yield judged(f"{label}: {MOVED}", found[MOVED], 0.93, 0.98, 0.85)
            yield judged(f"{label}: uniform poses", found["uniform poses"], 0.92, 0.98, 0.0)
    for model in IDENTIFIED if 300 in sizes else ():
        for preset in PRESETS:
            found = virtual_shares(preset, model, 300, arms)
            each = found["another day"] + found["uniform poses"]
            inside = np.concatenate([one.inside[~one.flagged] for one in each])
            uniform = np.concatenate([one.inside[~one.flagged] for one in found["uniform poses"]])
            now = f"{inside.mean():.1%} of all, {uniform.mean():.1%} of uniform ones"
            label = f"{model}, {preset}, 300 readings: poses not flagged"
            yield finding(label, "93 % to 97 %", now, bool(0.93 <= inside.mean() <= 0.97 and uniform.mean() >= 0.93))
    for name in ("ur10-b", "ur5"):
        shares, size = of_subsets(name, subsets)
        now = f"{shares.mean():.1%}, worst {shares.min():.0%}; median half axis {2.795 * size:.3f} mm"
        met = bool(0.93 <= shares.mean() <= 0.97)
        yield finding(f"{name}: {len(shares)} subsets of {SUBSET} readings", "93 % to 97 %", now, met)


# Arms of every topology ----------------------------------------------------------------------------------------------

# a [mm], alpha [deg], d [mm] of each joint of standard tables; which slide.
TOPOLOGIES: dict[str, tuple[list[tuple[float, float, float]], tuple[int, ...]]] = {
    "planar, 2 joints": ([(400, 0, 0), (350, 0, 0)], ()),
    "planar, 4 joints": ([(300, 0, 50), (250, 0, 0), (200, 0, 0), (100, 0, 0)], ()),
    "SCARA": ([(400, 0, 200), (350, 0, 0), (0, 0, 0), (60, 0, 0)], (3,)),
    "cylindrical": ([(0, 0, 200), (0, -90, 0), (0, 0, 300)], (2, 3)),
    "sliding last": ([(0, 90, 300), (0, 90, 100), (0, 0, 300)], (3,)),
    "two parallel, 3 joints": ([(0, 90, 300), (400, 0, 0), (350, 0, 0)], ()),
    "two parallel pairs": ([(0, 90, 300), (400, 0, 0), (0, 90, 0), (0, -90, 350), (200, 0, 0), (80, 0, 100)], ()),
    "sliding first, 7 joints": (
        [(0, 90, 0), (0, 90, 300), (500, 0, 0), (0, 90, 0), (0, -90, 400), (0, 90, 0), (50, 0, 100)],
        (1,),
    ),
    "8 joints": (
        [(0, 90, 300), (0, -90, 0), (0, 90, 400), (0, -90, 0), (0, 90, 350), (0, -90, 0), (0, 90, 0), (60, 0, 100)],
        (),
    ),
}
TURN, SLIDE = 2.0, 300.0  # rad about zero, mm from zero
CONSTANT_RAD, CONSTANT_MM, SHARE_OF_PRIOR, POINT_STD_MM = 1e-3, 0.5, 0.2, 0.02


def topology(name: str) -> Arm:
    """A nominal arm of the table."""
    rows, sliding = TOPOLOGIES[name]
    a, alpha, d = np.transpose(rows)
    slides = np.isin(np.arange(len(rows)) + 1, sliding)
    chain = chain_from_dh(
        a=a,
        alpha=np.radians(alpha),
        d=d,
        kinds=["prismatic" if one else "revolute" for one in slides],
        tip_in_flange=(30.0, 20.0, 40.0),
    )
    lower, upper = np.where(slides, 0.0, -TURN), np.where(slides, SLIDE, TURN)
    return Arm(name, chain, lower=lower, upper=upper, working_pose=(lower + upper) / 2)


def drawn(nominal: Arm, readings: int, seed: int, share: float) -> tuple[Session, Session]:
    """Readings at uniform poses of an arm with errors from the catalogue of terms, to learn from and to test."""
    chain, rng = nominal.chain, np.random.default_rng(seed)
    angles = rng.uniform(nominal.lower, nominal.upper, (readings + TESTED, nominal.n_joints))
    state = ArmState.of(nominal, angles)
    rigid = constants(chain, free=(), angle_std=CONSTANT_RAD, length_std=CONSTANT_MM)
    of_pose = missing_terms(state, ()) if share else []
    std = [term.prior_stds for term in rigid] + [share * term.prior_stds for term in of_pose]
    flat = np.concatenate(std)
    tips = PerturbedChain(chain, (*rigid, *of_pose)).tips(state, flat * rng.standard_normal(len(flat)))
    session = Session(angles, tips + POINT_STD_MM * rng.standard_normal(tips.shape))
    return session.rows(np.arange(readings)), session.rows(np.arange(readings, readings + TESTED))


@ROWS.row("topologies", quick={"arms": 1, "only": "SCARA"})
def topologies(arms: int = 4, readings: int = 100, model: str = "kinematic", only: str = "") -> RowResult:
    """Coverage of points, and u over their error, of arms of 2 to 8 joints, with parallel and sliding ones.

    Each arm is drawn twice: rigid, and with a fifth of the catalogue's wobble, eccentricity and bending. `only`: a part
    of the names.
    """
    table, targets = [], []
    for name in (one for one in TOPOLOGIES if only in one):
        nominal = topology(name)
        for share in (0.0, SHARE_OF_PRIOR):
            found = []
            for seed in range(arms):
                learned, tested = drawn(nominal, readings, seed, share)
                points, covariance = (
                    IDENTIFIED[model](nominal).fit_readings(learned).predict_readings(tested, return_cov=True)
                )
                inside = (squares(points - tested.points, covariance) < LEVEL).mean()
                ratio = np.trace(covariance, axis1=1, axis2=2).sum() / ((points - tested.points) ** 2).sum()
                found.append((inside, np.sqrt(ratio)))
            inside, ratio = np.transpose(found)
            label = f"{name}, {'with' if share else 'no'} terms of the pose"
            row = {"arm": label, "coverage": inside.mean(), "u over error": ratio.mean(), "largest": ratio.max()}
            table.append(row)
            targets.append(coverage(label, float(inside.mean()), "least", 0.92))
            targets.append(Target(f"u over error: {label}", float(ratio.mean()), 1.25, "below"))
    return RowResult(table, targets)


# Ways of measuring ----------------------------------------------------------------------------------------------------

NOMINAL, POSES, TEST_POSES = "ur10", 40, 60
OFFSETS = np.array([[0.0, 0.0, 0.0], [80.0, 10.0, -30.0], [-20.0, 95.0, 15.0]])


def with_tips(virtual: VirtualArm, measured: Measurement, seed: int) -> Session:
    """Each pose with a point of every tip, with the noise of the instrument."""
    state = replace(measured.state, angles=measured.true_angles)
    R, tips = virtual.perturbed_chain.poses(state, virtual.systematic.coefficients)
    points = tips[:, None] + np.einsum("nab,kb->nka", R, OFFSETS)
    noise = virtual.preset.reference_std_mm * np.random.default_rng(seed).standard_normal(points.shape)
    k = len(OFFSETS)
    readings = measured.readings.rows(np.repeat(np.arange(len(tips)), k))
    names = np.tile([f"N{i + 1}" for i in range(k)], len(tips))
    return replace(readings, points=(points + noise).reshape(-1, 3), point_std=None, tip=names, numbers=None)


def by_distances(arm_seed: int, model: str) -> ta.Evaluation:
    """The arm identified by wires and placed by points, tested on other points."""
    wires = ta.simulate(NOMINAL, poses=POSES, strategy="uniform", arm_seed=arm_seed, anchors=3, reference=False)
    seen = ta.simulate(NOMINAL, poses=TEST_POSES + 20, strategy="uniform", arm_seed=arm_seed, seed=1).session
    fitted = ta.fit(NOMINAL, wires.session, model=model).model
    placed = ta.refit(fitted, seen, free=["base"], n_readings=20).model
    return ta.evaluate(placed, seen)


def by_tips(arm_seed: int, model: str) -> ta.Evaluation:
    """The arm identified with three tips, tested on other poses with the same tips."""
    taken = [
        ta.simulate(NOMINAL, poses=n, strategy="uniform", arm_seed=arm_seed, seed=seed)
        for seed, n in enumerate((POSES, TEST_POSES))
    ]
    train, test = (with_tips(one.virtual, one.measurement, 100 + seed) for seed, one in enumerate(taken))
    return ta.evaluate(ta.fit(NOMINAL, train, model=model).model, test)


@ROWS.row("ways-of-measuring", quick={"arms": 1})
def ways_of_measuring(arms: int = 8, model: str = "kinematic") -> RowResult:
    """Distances to anchors and several tips on virtual arms: error and coverage of points of another day.

    Each arm is identified from 40 poses with three wires of 0.05 mm, placed by 20 points and tested on others; and from
    40 poses with three tips of which two have unknown offsets, tested on all three.
    """
    table = []
    for name, run in (("three wires", by_distances), ("three tips", by_tips)):
        found = [run(seed, model) for seed in range(arms)]
        error, nominal = (np.array([one.errors[of]["mean_mm"] for one in found]) for of in ("model", "nominal"))
        coverage = 100 * np.array([one.coverage for one in found])
        spread = f"{coverage.mean():.1f} ({coverage.min():.1f} to {coverage.max():.1f})"
        means = {"mean error [mm]": error.mean(), "nominal [mm]": nominal.mean()}
        table.append({"measured by": name, **means, "coverage of 95 % [%]": spread})
    return RowResult(table)
