"""Prediction under a payload, on a virtual UR10 with flexible joints and heavy links.

The arm has the errors of the preset `research` and compliances of a robot. The payload's centre of mass is 40 mm beyond
the nominal tip, and of the links' masses identification knows nothing or all. 250 readings are trained on, 300 tested.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

import truearm as ta
from machine import options_of, print_rows
from truearm.arm.masses import LinkMasses
from truearm.identification.terms import uniform_links
from truearm.identification.terms.thermal import link_vectors
from truearm.identification.virtual import PRESETS
from truearm.typing import FloatArray

NOISE_MM = 0.02
BEYOND_TIP_MM = np.array([0.0, 0.0, 40.0])
TRAINED = {"0 kg": (0.0,), "2 kg": (2.0,), "0 and 3 kg": (0.0, 3.0), "0 and 10 kg": (0.0, 10.0)}
TESTED_KG = (0.0, 5.0)
PRESET = replace(
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


def measured(virtual: ta.VirtualArm, kg: tuple[float, ...], n: int, *, seed: int) -> ta.Session:
    """Readings at uniform poses, the payloads by turns."""
    rng = np.random.default_rng(seed)
    arm, own = virtual.nominal, virtual.nominal.masses
    assert own is not None
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


def main() -> None:
    """Print errors and stated uncertainties."""
    options = options_of(__doc__, seed=3)
    arm = ta.load_arm("ur10")
    known = replace(arm, masses=links_of(arm))
    virtual = ta.VirtualArm.draw(known, PRESET, seed=options.seed)
    tests = {kg: measured(virtual, (kg,), 300, seed=100 + int(kg)) for kg in TESTED_KG}
    found = []
    for masses, nominal in (("unknown", arm), ("known", known)):
        for trained, kg in TRAINED.items():
            start = time.process_time()
            model = ta.PhysicalModel(nominal).fit_readings(measured(virtual, kg, 250, seed=1))
            row = {"masses": masses, "trained at": trained, "fit_cpu_s": time.process_time() - start}
            for tested, session in tests.items():
                points, covariance = model.predict_readings(session, return_cov=True)
                row[f"mean_mm at {tested:g} kg"] = float(np.linalg.norm(points - session.points, axis=1).mean())
                row[f"u_mm at {tested:g} kg"] = float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / 3))
            found.append(row)
    print_rows(found, as_json=options.json)


if __name__ == "__main__":
    main()
