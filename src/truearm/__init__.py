"""True coordinates from the joint angles of an articulated arm: identify, compensate, verify.

Names are imported when they are first used, so that ``import truearm`` is quick. `__init__.pyi` lists the same names
for type checkers and editors.
"""

from importlib import import_module as _import_module

__version__ = "0.1.0"

# Where each public name is defined.
_HOMES = {
    "truearm.acceptance": ("accepting",),
    "truearm.arm": ("Arm", "list_arms", "load_arm"),
    "truearm.models": ("HybridModel", "KinematicModel", "NetworkModel", "NominalModel", "PhysicalModel"),
    "truearm.models.model_file": ("load_model",),
    "truearm.errors": ("InputError",),
    "truearm.wings.laboratory.signatures.x509_certificates": ("Signer", "read_signer"),
    "truearm.wings.fleet.fleet": ("Fleet", "FleetRun"),
    "truearm.wings.fleet.fleet_status": ("FleetStatus",),
    "truearm.wings.fleet.type_prior": ("LearnedTypePrior",),
    "truearm.identification.terms": ("Expression", "Term"),
    "truearm.wings.planning.virtual": ("VirtualArm",),
    "truearm.wings.bench.live_server.live": ("live",),
    "truearm.readings": ("Lengths", "Session", "read_lengths", "read_session"),
    "truearm.wings.importing.foreign": ("import_table",),
    "truearm.wings.bench.sources": ("Notice", "Sample", "Source", "StandstillRule", "open_source"),
    "truearm.wings.laboratory.certificate.administrative_data": ("AdministrativeData",),
    "truearm.wings.laboratory.standards.artefacts": ("Artefacts", "read_artefacts"),
    "truearm.wings.laboratory.standards.measured_points": ("MeasuredPoints", "read_points"),
    "truearm.wings.laboratory.standards.specification": ("Specification", "read_specification"),
    "truearm.wings.laboratory.standards.verification_plan": ("VerificationPlan", "load_verification_plan"),
    "truearm.wings.planning.arm_from_circles": ("CircleArm", "arm_from_circles"),
    "truearm.wings.laboratory.verbs.artefacts_from_certificate": (
        "ArtefactsFromCertificate",
        "artefacts_from_certificate",
    ),
    "truearm.wings.laboratory.verbs.certificate": (
        "CertificateResult",
        "ReadCertificate",
        "certificate",
        "read_certificate",
    ),
    "truearm.wings.laboratory.verbs.check": ("CheckResult", "WithdrawalResult", "check", "withdraw_check"),
    "truearm.wings.reports.compare": ("ModelChange", "compare"),
    "truearm.wings.exports.correct": ("CorrectedTargets", "correct"),
    "truearm.verbs.diagnose": ("Diagnosis", "diagnose"),
    "truearm.verbs.evaluate": ("Evaluation", "evaluate"),
    "truearm.verbs.evaluate_large": ("LargeEvaluation", "evaluate_large"),
    "truearm.wings.exports.export": ("ExportCheck", "ExportResult", "check_export", "export"),
    "truearm.wings.importing.fetch": ("PublishedReadings", "fetch"),
    "truearm.wings.laboratory.verbs.fill_points": ("fill_points",),
    "truearm.verbs.fit": ("FitResult", "fit"),
    "truearm.verbs.fit_large": ("LargeFit", "fit_large"),
    "truearm.wings.laboratory.verbs.measure": ("MeasuredFeatures", "measure"),
    "truearm.wings.laboratory.verbs.operator_sheet": ("OperatorSheetResult", "operator_sheet"),
    "truearm.wings.planning.plan": ("CheckPlan", "PlanResult", "plan", "plan_check"),
    "truearm.verbs.predict": ("Prediction", "predict"),
    "truearm.verbs.predict_large": ("LargePrediction", "predict_large"),
    "truearm.wings.gao2017.carry_out": ("ProcedureResult",),
    "truearm.wings.bench.recording.record_readings": ("record",),
    "truearm.verbs.refit": ("RefitResult", "refit"),
    "truearm.wings.reports.report": ("ReportResult", "report"),
    "truearm.wings.gao2017.reproduce": ("ReproductionResult", "reproduce"),
    "truearm.wings.planning.simulate": ("SimulationResult", "rehearse", "simulate"),
    "truearm.wings.laboratory.verbs.simulate_verification": ("SimulatedVerification", "simulate_verification"),
    "truearm.wings.bench.recording.sources": ("SourceList", "SourceTrial", "list_sources", "try_source"),
    "truearm.wings.laboratory.verbs.task": ("TaskResult", "task"),
    "truearm.wings.laboratory.verbs.verify": ("VerificationResult", "verify"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

_MODULES = {"datasets": "truearm.wings.importing.datasets", "shapes": "truearm.wings.laboratory.shapes"}

__all__ = sorted([*_HOME_OF, *_MODULES, "__version__"])


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return _import_module(_MODULES[name])
    if name not in _HOME_OF:
        raise AttributeError(f"module 'truearm' has no attribute {name!r}")
    value = getattr(_import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
