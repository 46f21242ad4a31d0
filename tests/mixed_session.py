"""Readings of an arm that differs from its drawing, with references of many kinds; all of it drawn."""

from dataclasses import dataclass

import numpy as np

from truearm.arm import Arm, Chain
from truearm.arm.inverse_kinematics import solve_inverse_kinematics
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.references.references import Points, Reference, seats_of
from truearm.identification.references.surfaces import lines_of, planes_of, spheres_of
from truearm.identification.terms import ArmState, Term

# Standard deviations of the tip against each kind [mm]: across lines and planes, along the radius of spheres.
NOISE = {"point": 0.03, "seat": 0.01, "sphere": 0.005, "plane": 0.02, "line": 0.015}
RADIUS_MM, BAR_MM = 60.0, 300.0


@dataclass(frozen=True)
class Planted:
    """A session and what was planted: coefficients of terms, and the chain with them."""

    state: ArmState
    references: list[Reference]
    x: np.ndarray
    chain: Chain


def planted(arm: Arm, terms: list[Term], x: np.ndarray, rng: np.random.Generator, *, counts: dict[str, int]) -> Planted:
    """Measure the arm that constant terms `x` make of its drawing, `counts` readings of each kind.

    Seats are a bar apart whose length is known to 2 um; one sphere has a radius known to 1 um, the other not.
    """
    chain = PerturbedChain(arm.chain, tuple(terms)).with_constants(x)
    targets, names = [], []
    for kind, n in counts.items():
        start = arm.working + 0.5 * rng.uniform(-1, 1, (2, arm.n_joints))
        first, other = chain.tip_in_base(start)
        name = np.array(["A", "B"])[np.arange(n) % 2]
        where = np.where((name == "A")[:, None], first, other)
        match kind:
            case "point":
                true = chain.tip_in_base(arm.working + 0.8 * rng.uniform(-1, 1, (n, arm.n_joints)))
            case "seat":
                other = first + (other - first) * BAR_MM / np.linalg.norm(other - first)
                true = np.where((name == "A")[:, None], first, other) + rng.normal(0, NOISE[kind], (n, 3))
            case "sphere":
                true = where + (RADIUS_MM + rng.normal(0, NOISE[kind], (n, 1))) * unit(rng.normal(size=(n, 3)))
            case "plane" | "line":
                axes = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0][np.arange(n) % 2]
                spread = rng.uniform(-150, 150, (n, 3))
                across = [2] if kind == "plane" else [1, 2]
                spread[:, across] = rng.normal(0, NOISE[kind], (n, len(across)))
                true = where + np.einsum("nab,nb->na", axes, spread)
        targets.append(true)
        names.append(name)
    angles = np.concatenate([reached(arm, chain, target, rng) for target in targets])
    stops = np.cumsum([0, *counts.values()])
    references: list[Reference] = []
    for i, kind in enumerate(counts):
        rows = np.arange(stops[i], stops[i + 1])
        match kind:
            case "point":
                references.append(Points(rows, targets[i] + rng.normal(0, NOISE[kind], targets[i].shape)))
            case "seat":
                bar = ("A", "B", BAR_MM + rng.normal(0, 2e-3), 2e-3)
                references.append(seats_of(rows, names[i], [bar]))
            case "sphere":
                references.append(spheres_of(rows, names[i], [("A", RADIUS_MM + rng.normal(0, 1e-3), 1e-3)]))
            case "plane":
                references.append(planes_of(rows, names[i]))
            case "line":
                references.append(lines_of(rows, names[i]))
    return Planted(ArmState(arm.chain, angles), references, x, chain)


def reached(
    arm: Arm, chain: Chain, targets: np.ndarray, rng: np.random.Generator, *, half_width: float = 0.8
) -> np.ndarray:
    """Angles that bring the chain's tip to targets (n, 3), from postures all over the arm."""
    angles, missing = np.empty((len(targets), arm.n_joints)), np.ones(len(targets), bool)
    for _ in range(50):
        start = arm.working + half_width * rng.uniform(-1, 1, (missing.sum(), arm.n_joints))
        found = solve_inverse_kinematics(chain, targets[missing], start=start, tolerance_mm=1e-9)
        rows = np.flatnonzero(missing)[found.reached]
        angles[rows], missing[rows] = found.angles[found.reached], False
        if not missing.any():
            return angles
    raise AssertionError("the targets are out of reach")


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) of length 1."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def scale_std(found: IdentificationResult, state: ArmState) -> float:
    """Standard uncertainty of the scale of the tips, as a share."""
    tips = found.tips(state)
    apart = tips - tips.mean(axis=0)
    pieces = found.perturbed_chain.derivatives(state, found.coefficients)
    by = sum(np.einsum("nc,pcn->p", apart[rows], columns) for rows, _, columns in pieces) / (apart**2).sum()
    return float(np.sqrt(by @ found.covariance @ by))
