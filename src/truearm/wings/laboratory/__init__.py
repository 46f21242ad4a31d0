"""Verify: tests of an arm against its specification, and what its errors do to a measured feature."""

from typing import Literal

DecisionRule = Literal["iso14253-1:2017", "iso14253-1:2013", "simple"]
TemplateKind = Literal["artefacts", "mpe"]
FeatureKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone", "angle", "distance"]
MeasuredKind = Literal["length", "sphere", "plane", "circle", "cylinder", "cone"]

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {
    "signatures.x509_certificates": ("Signer", "read_signer"),
    "certificate.administrative_data": ("AdministrativeData",),
    "standards.artefacts": ("Artefacts", "read_artefacts"),
    "standards.measured_points": ("MeasuredPoints", "read_points"),
    "standards.specification": ("Specification", "read_specification"),
    "standards.verification_plan": ("VerificationPlan", "load_verification_plan"),
    "verbs.certificate": (
        *("ArtefactsFromCertificate", "CertificateResult", "ReadCertificate"),
        *("artefacts_from_certificate", "certificate", "read_certificate"),
    ),
    "verbs.check": ("CheckResult", "WithdrawalResult", "check", "withdraw_check"),
    "verbs.measure": ("MeasuredFeatures", "measure"),
    "verbs.operator_sheet": ("OperatorSheetResult", "fill_points", "operator_sheet"),
    "verbs.simulate_verification": ("SimulatedVerification", "simulate_verification"),
    "verbs.task": ("TaskResult", "task"),
    "verbs.verify": ("VerificationResult", "verify"),
}
MODULES = ("shapes",)  # public as it stands
COMMANDS = {
    "verify": "verbs.verify_command:verify",
    "task": "verbs.commands:task",
    "measure": "verbs.commands:measure",
    "check": "verbs.commands:check",
    "certificate": "verbs.commands:certificate",
}
