"""A made-up verification: an arm with known errors, and the files a technician would have of it."""

import csv
import io

import numpy as np

SPHERE_MM, LENGTHS_MM = 25.0004, (150.001, 450.002, 900.003, 1300.004, 1700.005)

ARTEFACTS = f"""\
[[spheres]]
name = "ball"
certificate = "K-101"
issued_by = "Example Calibration"
issuer_accreditation = "X-K-00001-01-00"
date = 2026-01-15
expires = 2028-01-15
nominal_mm = 25
diameter_mm = {SPHERE_MM}
u_diameter_mm = 0.0002
form_mm = 0.0003
expansion_per_K = 5.5e-6
u_expansion_per_K = 0.5e-6
u_temperature_K = 0.3
u_fixture_mm = 0.0005

[[bars]]
name = "bar"
certificate = "K-102"
issued_by = "Example Calibration"
issuer_accreditation = "X-K-00001-01-00"
date = 2026-01-15
expires = 2028-01-15
form_mm = 0.0005
expansion_per_K = 1e-6
u_expansion_per_K = 0.3e-6
u_temperature_K = 0.5
u_fixture_mm = 0.002
u_alignment_mm = 0.3
lengths = [
{
    chr(10).join(
        f'  {{ name = "{length:.0f}", nominal_mm = {length:.0f}, length_mm = {length}, u_mm = 0.0005 }},'
        for length in LENGTHS_MM
    )
}
]

[[seats]]
name = "cone"
certificate = "made here, roundness of its rim measured"
issued_by = "Example Laboratory"
date = 2026-01-15
expires = 2028-01-15
form_mm = 0.001
u_fixture_mm = 0.001
"""

MPE = """\
name = "measuring arm 2.5 m"
source = "its data sheet"
measuring_range_mm = 2500

[rated_conditions]
air_degC = { min = 15, max = 25 }

[limits]
"P_Size.Sph.1x25::Tact.AArm" = { B_um = 15 }
"P_Form.Sph.1x25" = { B_um = 30 }
"L_Dia.5x5:Art:Tact.AArm" = { B_um = 40 }
E_Uni = { A_um = 15, K_mm_per_um = 80, B_um = 50 }
E_Bi = { B_um = 60 }
EffectiveDiameter = { B_um = 20 }
"SPAT.Max" = { B_um = 30 }
"SPAT.2s" = { B_um = 40 }
"Volumetric.Max" = { B_um = 50 }
"""

COLUMNS = ("test", "artefact", "date", "position", "length", "repeat", "end", "group",
           "x_mm", "y_mm", "z_mm", "artefact_degC")  # fmt: skip


def hemisphere():
    """The pattern of 25 points of ISO 10360-5: pole, 4, 8, 4, 8 (25, 3)."""
    rows = [(0.0, 1, 0.0), (22.5, 4, 0.0), (45.0, 8, 22.5), (67.5, 4, 22.5), (90.0, 8, 22.5)]
    return np.array(
        [
            (np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a))
            for polar, n, turn in rows
            for a, b in ((np.radians(polar), np.radians(turn) + 2 * np.pi * i / n) for i in range(n))
        ]
    )


class Made:
    """Rows of a points file, of an arm that measures all too large by a share, with noise."""

    def __init__(self, *, noise_mm=0.001, too_large=0.0, away_mm=0.005, degC=20.0, seed=1):
        self.rng = np.random.default_rng(seed)
        self.noise, self.too_large, self.away, self.degC = noise_mm, too_large, away_mm, degC
        self.rows: list[dict[str, str]] = []

    def add(self, test, artefact, points, **keys):
        points = np.atleast_2d(points) * (1 + self.too_large)
        for point in points + self.noise * self.rng.normal(size=points.shape):
            x, y, z = (f"{value:.5f}" for value in point)
            self.rows.append(
                {"test": test, "artefact": artefact, "date": "2026-11-03", "artefact_degC": f"{self.degC}"}
                | {"x_mm": x, "y_mm": y, "z_mm": z}
                | {key: str(value) for key, value in keys.items()}
            )

    def iso(self, *, bi=False):
        """All tests of ISO 10360-12."""
        away = SPHERE_MM / 2 * hemisphere()
        for position, middle in ((1, [500, 0, 200]), (2, [900, 300, 100])):
            self.add("probing", "ball", middle + away, position=position)
            for group in range(5):
                turned = self.away * self.rng.normal(size=3) / 2
                five = SPHERE_MM / 2 * np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0.0]])
                turn = np.linalg.qr(self.rng.normal(size=(3, 3)))[0]
                points = middle + turned + five @ turn
                self.add("articulation", "ball", points, position=position, group="ABCDE"[group])
        for test in ("uni", "bi") if bi else ("uni",):
            for length in LENGTHS_MM:
                for position in range(1, 8):
                    start = np.array([-400.0, 100, 0]) + 50 * self.rng.normal(size=3)
                    direction = self.rng.normal(size=3)
                    direction /= np.linalg.norm(direction)
                    start -= length / 2 * direction  # within the arm's reach, whatever the direction
                    for repeat in (1, 2, 3):
                        keys = {"length": f"{length:.0f}", "position": position, "repeat": repeat}
                        grown = length * (1 + 1e-6 * (self.degC - 20))
                        self.add(test, "bar", start, end="A", **keys)
                        self.add(test, "bar", start + grown * direction, end="B", **keys)
        return self

    def asme(self):
        """All tests of ASME B89.4.22."""
        nine = hemisphere()[[0, *range(5, 13, 2), *range(17, 25, 2)]]
        for repeat in (1, 2, 3):
            self.add("effective_diameter", "ball", [600, 0, 200] + SPHERE_MM / 2 * nine, repeat=repeat)
        for zone, middle in (("near", [200, 0, 0]), ("middle", [600, 0, 0]), ("far", [1150, 0, 0.0])):
            self.add("single_point", "cone", np.tile(middle, (10, 1)), position=zone)
        for i in range(20):
            length = LENGTHS_MM[2] if i < 10 else LENGTHS_MM[4]
            direction = self.rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            keys = {"length": f"{length:.0f}", "position": i + 1}
            for end, side in (("A", -0.5), ("B", 0.5)):
                self.add("volumetric", "bar", side * length * direction, end=end, **keys)
        return self

    def text(self, serial_number=None, **origin):
        """The file; with columns for the serial number of the arm and the origin, if a number is given."""
        origin = origin or {"coordinates_from": "arm software"}
        unit = {} if serial_number is None else {"serial_number": serial_number, **origin}
        out = io.StringIO()
        writer = csv.DictWriter(out, (*COLUMNS, *unit), restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(row | unit for row in self.rows)
        return out.getvalue()
