"""``truearm verify --simulate``: a standard's test taken by virtual arms."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor
from pathlib import Path
from typing import TYPE_CHECKING

from truearm.cli.console import print_json, print_line, print_table, progress

if TYPE_CHECKING:
    from truearm.arm.arm import Arm
    from truearm.verification.standards.artefacts import Artefacts
    from truearm.verification.standards.decision import DecisionRule
    from truearm.verification.standards.specification import Specification
    from truearm.verification.standards.verification_plan import VerificationPlan
    from truearm.verification.tasks.sampled_arms import ArmDistribution
    from truearm.verification.tasks.simulated_verification import PosedTest, ResultDistribution

ARM = "measuring7"
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6)


def simulate_test(
    what: str,
    *,
    arm: str | None,
    plan: str,
    artefacts: Path | None,
    mpe: Path | None,
    n_arms: int,
    seed: int,
    rule: DecisionRule,
    as_json: bool,
) -> None:
    """Take a test with virtual arms of a preset or a model, and print what they would pass."""
    from truearm.verification.standards.decision import Verdict
    from truearm.verification.standards.verification_plan import load_verification_plan
    from truearm.verification.tasks.simulated_verification import (
        proportion_interval,
        result_distributions,
        simulate_verification,
        verdict_shares,
    )

    planned = load_verification_plan(plan)
    errors = _errors(what, arm)
    with progress("finding poses"):
        specification, certified, posed = _prepared(errors.arm, planned, artefacts=artefacts, mpe=mpe, seed=seed)
    with progress(f"taking the test with {n_arms} virtual arms", n_arms) as tell:
        found = simulate_verification(
            errors,
            posed,
            plan=planned,
            artefacts=certified,
            specification=specification,
            n_arms=n_arms,
            seed=seed,
            rule=rule,
            progress=lambda done: tell(done, ""),
        )
    shares = verdict_shares(found)
    conform = sum(one.verdict is Verdict.CONFORM for one in found)
    low, high = proportion_interval(conform, n_arms)
    rows = result_distributions(found)
    if as_json:
        print_json(
            {
                "simulated": what,
                "arm": errors.arm.name,
                "arms": n_arms,
                "seed": seed,
                "plan": planned.name,
                "standard": planned.standard,
                "specification": specification.name,
                "artefacts": "example" if artefacts is None else str(artefacts),
                "rule": rule,
                "rows": [
                    {
                        "label": row.label,
                        "unit": row.unit,
                        "median": row.median,
                        "quantile_95": row.high,
                        "limit": row.limit,
                        "conform": row.conform,
                        "not_conform": row.not_conform,
                        "undecided": row.undecided,
                    }
                    for row in rows
                ],
                "all": {verdict.value.replace(" ", "_"): share for verdict, share in shares.items()},
                "conform_interval_95": [low, high],
                "remarks": list(found[0].remarks),
            }
        )
        return
    print_line(f"{planned.title}: {n_arms} virtual arms {errors.arm.name}, {what}")
    print_line(f"limits: {specification.name}, {specification.source}")
    if artefacts is None:
        print_line("artefacts: examples, no calibration of yours")
    _say_rows(rows, [shares[verdict] for verdict in (Verdict.CONFORM, Verdict.NOT_CONFORM, Verdict.UNDECIDED)])
    print_line("median, 95 %: half of the arms, and 95 % of them, have a smaller magnitude")
    print_line(
        f"conform in all: {conform} of {n_arms} arms, which means {floor(100 * low)} % to {ceil(100 * high)} % of all "
        f"such arms (95 % confidence); 100 % in a line means {floor(100 * proportion_interval(n_arms, n_arms)[0])} % or more"
    )
    for remark in found[0].remarks:
        print_line(remark)


def _prepared(
    arm: Arm, plan: VerificationPlan, *, artefacts: Path | None, mpe: Path | None, seed: int
) -> tuple[Specification, Artefacts, PosedTest]:
    """The test as posed for an arm.

    The measuring range is that of the specification; without one, the largest out of some shares of what the arm's
    links add up to in which all points are reached.
    """
    from truearm.errors import InputError
    from truearm.identification.planning.sampling.measuring import check_five_rotary_joints
    from truearm.identification.planning.sampling.workspace import stance
    from truearm.verification.standards.layout import lay_out_tests
    from truearm.verification.tasks.simulated_verification import pose

    check_five_rotary_joints(arm)
    stands = stance(arm)
    for share in SHARES:
        whole = 2 * share * stands.reach_mm
        # In round numbers, as data sheets have it.
        specification, certified = given_or_example(100 * int(whole / 100) or whole, mpe=mpe, artefacts=artefacts)
        shoulder = float(stands.shoulder_in_base[2])
        layout = lay_out_tests(plan, certified, specification.measuring_range_mm, shoulder_mm=shoulder)
        try:
            return specification, certified, pose(layout, arm, seed=seed)
        except InputError as error:
            if mpe is not None:
                hint = f"{error.hint}; without --mpe, a range that the arm reaches is looked for"
                raise InputError(error.problem, hint=hint) from None
            if share == SHARES[-1] or stands.reach_mm == 0:
                raise
    raise AssertionError("the last share is returned or raised")


def given_or_example(
    measuring_range_mm: float, *, mpe: Path | None, artefacts: Path | None
) -> tuple[Specification, Artefacts]:
    """The specification and the artefacts from files, or examples for a measuring range."""
    from truearm.verification.standards.artefacts import example_artefacts, read_artefacts
    from truearm.verification.standards.specification import example_specification, read_specification

    specification = example_specification(measuring_range_mm) if mpe is None else read_specification(mpe)
    range_mm = specification.measuring_range_mm
    return specification, example_artefacts(range_mm) if artefacts is None else read_artefacts(artefacts)


def _errors(what: str, arm: str | None) -> ArmDistribution:
    from truearm.arm.catalogue import list_arms, load_arm
    from truearm.compensation.models.model_file import load_model
    from truearm.errors import InputError
    from truearm.identification.virtual import PRESETS
    from truearm.verification.tasks.sampled_arms import PosteriorDistribution, PresetDistribution

    if what in PRESETS:
        return PresetDistribution(load_arm(arm or ARM), PRESETS[what])
    if what in list_arms() or Path(what).suffix.lower() in (".toml", ".urdf"):
        raise InputError(
            f"expected a preset or a model file to simulate, got the arm {what!r}", hint=f"--simulate shop --arm {what}"
        )
    if not Path(what).exists():
        raise InputError(
            f"expected a preset or a model file to simulate, got {what!r}",
            hint=f"{', '.join(PRESETS)}, or MODEL.truearm",
        )
    if arm is not None:
        raise InputError("--arm is for presets: a model has its arm", hint="leave --arm out")
    return PosteriorDistribution(load_model(what))


def _say_rows(rows: Sequence[ResultDistribution], whole: Sequence[float]) -> None:
    cells = []
    for row in rows:
        digits = ".4f" if row.unit == "mm" else "g"  # else a count
        limit = "" if row.limit is None else format(row.limit, digits)
        shares = ["", "", ""] if row.limit is None else _percent([row.conform, row.not_conform, row.undecided])
        cells.append([row.label, format(row.median, digits), format(row.high, digits), limit, *shares])
    cells.append(["all of it", "", "", "", *_percent(whole)])
    print_table(["test", "median [mm]", "95 % [mm]", "limit [mm]", "conform", "not conform", "undecided"], cells)


def _percent(shares: Sequence[float]) -> list[str]:
    return [f"{100 * share:.3g} %" for share in shares]
