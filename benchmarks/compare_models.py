"""Does `compare` name what changed, and nothing else? Pairs of models of virtual arms from different readings.

    python benchmarks/compare_models.py [--pairs 40] [--arm gao2017] [--readings 100] [--preset research] [--json]

Each arm is measured twice at other poses. Of an unchanged arm the constants and the tip may count as changed in 5 % of
pairs each. Then the joint offset of one of the inner joints in turn is changed before the second session.

With --ur10: models of the published series A (2000 of its readings) and B of a UR10, which overlap in few poses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import truearm as ta
from machine import arguments_of, print_json, print_table, say_machine

KINDS = ("kinematic", "physical")


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


def compare_series(kinds: list[str]) -> None:
    """Print what changed in the UR10 from series A to B, by each kind of model."""
    first, second = (ta.fetch(name).session for name in ("ur10-a", "ur10-b"))
    rows = np.sort(np.random.default_rng(1).permutation(len(first))[:2000])
    say_machine()
    for kind in kinds:
        old, new = (ta.fit("ur10", session, model=kind).model for session in (first.rows(rows), second))
        print(f"\n{kind}\n{ta.compare(old, new)}")


def main() -> None:
    """Measure and print."""
    parser = arguments_of(__doc__)
    parser.add_argument("--pairs", type=int, default=40, help="virtual arms, 40 by default")
    parser.add_argument("--arm", default="gao2017")
    parser.add_argument("--readings", type=int, default=100, help="readings of each model, 100 by default")
    parser.add_argument("--preset", default="research")
    parser.add_argument("--strategy", default="box")
    parser.add_argument("--offset", type=float, default=0.1, help="change of the joint offset [deg], 0.1 by default")
    parser.add_argument("--models", nargs="+", default=KINDS, choices=KINDS, help="both by default")
    parser.add_argument("--ur10", action="store_true", help="models of the published readings of a UR10 instead")
    options = parser.parse_args()
    if options.ur10:
        compare_series(options.models)
        return
    arm = ta.load_arm(options.arm)
    common = {"poses": options.readings, "preset": options.preset, "strategy": options.strategy}
    found: dict[str, dict[str, list[dict[str, float]]]] = {
        kind: {"unchanged": [], "changed": []} for kind in options.models
    }
    for pair in range(options.pairs):
        first, second = (ta.simulate(arm, seed=2 * pair + 1 + k, arm_seed=pair, **common).session for k in range(2))
        joint = 1 + pair % (arm.n_joints - 2)
        for kind, each in found.items():
            old = ta.fit(arm, first, model=kind).model
            for what, offset in (("unchanged", 0.0), ("changed", options.offset)):
                new = ta.fit(arm, with_offset(second, joint, offset), model=kind).model
                each[what].append(judge(ta.compare(old, new), arm.joint_names[joint], offset))
    if options.json:
        print_json({"pairs": found}, [])
        return
    say_machine()
    print(f"\n{options.pairs} arms {options.arm}, preset {options.preset}, {options.readings} readings a model\n")
    rows = []
    for kind, each in found.items():
        of = {what: {name: [one[name] for one in pairs] for name in pairs[0]} for what, pairs in each.items()}
        still, moved = of["unchanged"], of["changed"]
        counts = [still["constants"], still["tip"], *(moved[name] for name in ("found", "within_U", "others", "tip"))]
        medians = f"{np.median(still['n_constants']):.0f}", f"{np.median(moved['U_deg']):.3f}"
        rows.append([kind, medians[0], *(f"{sum(count):.0f}" for count in counts), medians[1]])
    print_table(["model", "constants", "alarm", "tip alarm", "found", "within U", "others", "tip", "U, deg"], rows)


if __name__ == "__main__":
    main()
