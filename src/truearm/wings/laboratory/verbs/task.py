"""`task`: the uncertainty of a measured feature, and whether an arm is good enough for a tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from zipfile import is_zipfile

import numpy.typing as npt

from truearm.arm import Arm
from truearm.arm.catalogue import known_name
from truearm.choices import Conditions
from truearm.errors import InputError
from truearm.models import Compensator, load_model
from truearm.pages.drawings.page_record import PageRecord, arm_row, input_files, version_row
from truearm.solve.threads import one_blas_thread
from truearm.verbs.inputs import ArmLike, to_arm, to_model_of_tip
from truearm.verbs.record import SAME_DAY, TableRecord, TextTable, columns_of, format_fixed
from truearm.wings.laboratory import FeatureKind
from truearm.wings.laboratory.standards.specification import Specification, read_specification
from truearm.wings.laboratory.tasks.estimate import Estimate, Fitness, describe_fitness
from truearm.wings.laboratory.tasks.feature_postures import place_feature
from truearm.wings.laboratory.tasks.features import Feature
from truearm.wings.laboratory.tasks.sampled_arms import ArmDistribution, PosteriorDistribution, PresetDistribution
from truearm.wings.laboratory.tasks.specification_sheet import SpecificationDistribution
from truearm.wings.laboratory.tasks.task import TaskAssessment, assess_task
from truearm.wings.planning.virtual.presets import PRESETS, Preset, load_preset

if TYPE_CHECKING:
    from truearm.pages.page import Page
    from truearm.pages.plotting import Figure

ArmSource: TypeAlias = Compensator | Preset | Specification | str | Path

# The generic measuring arm, of the size that the presets are made for.
NOMINAL_ARM = "measuring7"


@dataclass(frozen=True, eq=False, repr=False)
class TaskResult(TableRecord, PageRecord):
    """The uncertainty of a measured feature and, with a tolerance, whether the arm is fit for it.

    Attributes
    ----------
    assessment : TaskAssessment
        The errors of the simulated measurements, the comparison with the tolerance, and the assumptions.
    arm : Arm
        The nominal arm.
    source : str
        What is known of the errors of the arm.
    seed : int
        Seed of all random numbers.
    files : tuple of Path
        The files that were read.
    """

    assessment: TaskAssessment
    arm: Arm
    source: str
    seed: int
    files: tuple[Path, ...] = ()

    @property
    def fitness(self) -> Fitness | None:
        """The comparison with the tolerance; None without one."""
        return self.assessment.fitness

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Error and uncertainty of each quantity of the feature; the tolerance is about the first."""
        return self.assessment.result.estimates

    @property
    def remarks(self) -> tuple[str, ...]:
        """Conditions and assumptions of the result."""
        return self.assessment.remarks

    def page(self) -> Page:
        """The result with the distribution of the errors."""
        from truearm.wings.laboratory.pages.task_page import task_page

        result = self.assessment.result
        facts = [
            ("source of the errors", self.source),
            arm_row(self.arm),
            ("arms drawn", f"{result.n_arms}, seed {self.seed}"),
            ("sets of postures", str(len(result.angles))),
            version_row(),
        ]
        return task_page(self.assessment, arm=self.arm, source=self.source, facts=facts)

    def figure(self) -> Figure:
        """Histograms of the errors with their 95 % intervals."""
        from truearm.wings.laboratory.pages.task_page import errors_figure

        return errors_figure(self.estimates, self.fitness)

    def blocks(self) -> Iterator[str | TextTable]:
        """See `Record`."""
        result, first = self.assessment.result, self.estimates[0]
        if self.fitness is not None:
            yield describe_fitness(first, self.fitness)
        yield (
            f"{result.feature.name}: U = {first.expanded_mm:.4f} mm (95 %), errors of {result.n_arms} drawn arms from "
            f"{self.source}"
        )
        heads = ["quantity", "bias [mm]", "u [mm]", "95 % of errors [mm]", "u systematic", "u random"]
        yield TextTable(heads, map(_cells, self.estimates))
        of_draws = first.standard_errors
        yield (
            f"standard errors due to the number of draws ({first.quantity.name}): bias {of_draws.bias_mm:.4f}, "
            f"u {of_draws.u_mm:.4f}, ends of the interval {of_draws.low_mm:.4f} and {of_draws.high_mm:.4f} mm"
        )
        yield self.assessment.advice
        yield from self.remarks

    def columns(self) -> dict[str, list[Any]]:
        """A row for each quantity of the feature, with the shortest interval of 95 % of its errors."""
        rows = []
        for one in self.estimates:
            low, high = one.interval_mm
            rows.append({**one.to_dict(), "low_mm": low, "high_mm": high})
        return columns_of(rows)

    def _json(self) -> object:
        return {"source": self.source, **self.assessment.to_dict()}


@one_blas_thread()
def task(
    source: ArmSource,
    feature: FeatureKind | Feature = "length",
    size_mm: float | None = None,
    *,
    tolerance_mm: float | None = None,
    at: npt.ArrayLike | None = None,
    along: npt.ArrayLike | None = None,
    n_points: int | None = None,
    second: float | None = None,
    arm: ArmLike | None = None,
    repeatability_mm: float | None = None,
    conditions: Conditions = "reproducibility",
    n_arms: int = 1000,
    seed: int = 0,
    progress: Callable[[int, str], None] | None = None,
) -> TaskResult:
    """Estimate the uncertainty with which an arm measures a feature, and compare it with a tolerance.

    Many arms are drawn that may be the one in question, and each measures the feature (JCGM 101).

    Parameters
    ----------
    source : identified model, Preset, Specification, str or path
        What is known of the arm. A model (file): arms from its posterior. A preset (``shop``,
        ``worn``, ``printed``, ``research``, ``perfect``): any arm like that. A specification (file, ``.toml``): any arm
        that meets it.
    feature : {"length", "sphere", "plane", "circle", "cylinder", "cone", "angle", "distance"} or Feature
        What is measured; angle and distance are those of two planes.
    size_mm : float, optional
        Length, diameter of a sphere, circle, cylinder or cone, side of a square plane, distance of two planes [mm]. Not
        with a length between two seats.
    tolerance_mm : float, optional
        Width of the tolerance zone [mm]: 0.1 for +-0.05 mm.
    at : (3,) or (2, 3) array, optional
        Middle of the feature, or the two seats of a length [mm], in the base frame of the arm; by default the middle of
        the volume in which a person works.
    along : (3,) array, optional
        Direction of a length (by default across the front), normal of a plane, axis of a
        circle, cylinder or cone (by default up), edge of an angle (by default towards the front).
    n_points : int, optional
        Points in all: 25, of two planes 24; of a length 2, half of them at each end.
    second : float, optional
        Depth of a cylinder or side of the planes of a distance [mm] (50), angle of a cone or of two planes [deg] (90).
    arm : Arm, str or path, optional
        The nominal arm of a preset or a specification; by default ``measuring7``.
    repeatability_mm : float, optional
        Measured standard deviation of a coordinate when a point is measured again in the same pose [mm], of a model.
        Without it no error counts as random, and the uncertainty of means is overestimated.
    conditions : {"reproducibility", "repeatability"}
        Of a model: what the uncertainty is for (`Compensator.under`), any day, or the day and set-up of the training
        readings. A preset and a specification have one.
    n_arms : int
        Number of arms to draw.
    seed : int
        Seed of all random numbers.
    progress : callable, optional
        Called with the number of arms done and a remark.

    Returns
    -------
    TaskResult

    Raises
    ------
    InputError
        If the arm does not reach the feature, or sizes do not suit it.

    Examples
    --------
    >>> import truearm as ta
    >>> result = ta.task("perfect", "length", 300, tolerance_mm=0.1, n_arms=100)
    >>> result.fitness.answer.value
    'yes'
    """
    if tolerance_mm is not None and not (isfinite(tolerance_mm) and tolerance_mm > 0):
        raise InputError(
            f"the tolerance must be a width above zero in mm, got {tolerance_mm}", hint="0.1 for +-0.05 mm"
        )
    arms, about = to_arm_distribution(source, arm, repeatability_mm=repeatability_mm, conditions=conditions)
    if not isinstance(arms, PosteriorDistribution):
        about = f"{about}, arm {arms.arm.name}"
    if not isinstance(feature, Feature):
        feature = place_feature(feature, size_mm, arms.arm, at=at, along=along, n_points=n_points, second=second)
    assessment = assess_task(arms, feature, tolerance_mm=tolerance_mm, n_arms=n_arms, seed=seed, progress=progress)
    return TaskResult(assessment, arms.arm, about, seed, input_files(source, arm))


def to_arm_distribution(
    source: ArmSource,
    arm: ArmLike | None = None,
    *,
    repeatability_mm: float | None = None,
    conditions: Conditions = "reproducibility",
) -> tuple[ArmDistribution, str]:
    """The arms that may be the one in question, and what is known of it in a few words; parameters as of `task`.

    Raises
    ------
    InputError
        If `source` is nothing of the kind, or the other parameters do not apply to it.
    """
    file = Path(source) if isinstance(source, str | Path) and str(source) not in PRESETS else None
    known = source if file is None else _read_source(file)
    if isinstance(known, Compensator):
        if arm is not None:
            raise InputError("a nominal arm is for a preset or a specification; a model has its own arm", file=file)
        to_model_of_tip(known)
        about = f"the model {file.name}" if file is not None else f"a model of {known.n_train_} readings"
        with InputError.of_file(file):
            about += "" if conditions == "reproducibility" else f", {SAME_DAY}"
            return PosteriorDistribution(known.under(conditions), repeatability_mm), about
    if repeatability_mm is not None:
        raise InputError("a repeatability is for a model; a preset or a specification has its own random errors")
    if conditions == "repeatability":
        raise InputError("conditions are for a model; a preset or a specification has one uncertainty, of any day")
    nominal = to_arm(NOMINAL_ARM if arm is None else arm)
    if isinstance(known, Specification):
        with InputError.of_file(file):
            return SpecificationDistribution(nominal, known), f"the specification of {known.name}"
    preset = known if isinstance(known, Preset) else load_preset(str(known))
    return PresetDistribution(nominal, preset), f"the preset {preset.name}"


def _read_source(file: Path) -> Compensator | Specification:
    if file.is_file() and is_zipfile(file):
        return load_model(file)
    is_arm = known_name(str(file)) is not None or file.suffix.lower() == ".urdf"
    if file.suffix.lower() == ".toml" and not is_arm:
        return read_specification(file)
    raise InputError(
        f"expected a model file, a specification (.toml) or a preset ({', '.join(PRESETS)}), "
        f"got {'the arm ' if is_arm else ''}{str(file)!r}",
        hint=f"shop, with --arm {file}" if is_arm else "truearm fit writes a model file",
    )


def _cells(one: Estimate) -> Sequence[str]:
    low, high = one.interval_mm
    return (
        one.quantity.name,
        format_fixed(one.bias_mm, sign=True),
        f"{one.u_mm:.4f}",
        f"{format_fixed(low, sign=True)} to {format_fixed(high, sign=True)}",
        f"{one.u_systematic_mm:.4f}",
        f"{one.u_random_mm:.4f}",
    )
