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
    "truearm.compensation.models": ("HybridModel", "KinematicModel", "NetworkModel", "NominalModel", "PhysicalModel"),
    "truearm.compensation.models.model_file": ("load_model",),
    "truearm.errors": ("InputError",),
    "truearm.files.x509_certificates": ("Signer", "read_signer"),
    "truearm.fleet.fleet": ("Fleet", "FleetRun"),
    "truearm.fleet.fleet_status": ("FleetStatus",),
    "truearm.fleet.type_prior": ("LearnedTypePrior",),
    "truearm.identification.terms": ("Expression", "Term"),
    "truearm.identification.virtual": ("VirtualArm",),
    "truearm.live_server.live": ("live",),
    "truearm.readings": ("Lengths", "Session", "read_lengths", "read_session"),
    "truearm.readings.foreign": ("import_table",),
    "truearm.sources": ("Notice", "Sample", "Source", "StandstillRule", "open_source"),
    "truearm.verification.certificate.administrative_data": ("AdministrativeData",),
    "truearm.verification.standards.artefacts": ("Artefacts", "read_artefacts"),
    "truearm.verification.standards.measured_points": ("MeasuredPoints", "read_points"),
    "truearm.verification.standards.specification": ("Specification", "read_specification"),
    "truearm.verification.standards.verification_plan": ("VerificationPlan", "load_verification_plan"),
    "truearm.workflows.arm_from_circles": ("CircleArm", "arm_from_circles"),
    "truearm.workflows.artefacts_from_certificate": ("ArtefactsFromCertificate", "artefacts_from_certificate"),
    "truearm.workflows.certificate": ("CertificateResult", "ReadCertificate", "certificate", "read_certificate"),
    "truearm.workflows.check": ("CheckResult", "WithdrawalResult", "check", "withdraw_check"),
    "truearm.workflows.compare": ("ModelChange", "compare"),
    "truearm.workflows.correct": ("CorrectedTargets", "correct"),
    "truearm.workflows.diagnose": ("Diagnosis", "diagnose"),
    "truearm.workflows.evaluate": ("Evaluation", "evaluate"),
    "truearm.workflows.evaluate_large": ("LargeEvaluation", "evaluate_large"),
    "truearm.workflows.export": ("ExportCheck", "ExportResult", "check_export", "export"),
    "truearm.workflows.fetch": ("PublishedReadings", "fetch"),
    "truearm.workflows.fill_points": ("fill_points",),
    "truearm.workflows.fit": ("FitResult", "fit"),
    "truearm.workflows.fit_large": ("LargeFit", "fit_large"),
    "truearm.workflows.measure": ("MeasuredFeatures", "measure"),
    "truearm.workflows.operator_sheet": ("OperatorSheetResult", "operator_sheet"),
    "truearm.workflows.plan": ("CheckPlan", "PlanResult", "plan", "plan_check"),
    "truearm.workflows.predict": ("Prediction", "predict"),
    "truearm.workflows.predict_large": ("LargePrediction", "predict_large"),
    "truearm.workflows.procedure": ("ProcedureResult",),
    "truearm.recording.record_readings": ("record",),
    "truearm.workflows.refit": ("RefitResult", "refit"),
    "truearm.workflows.report": ("ReportResult", "report"),
    "truearm.workflows.reproduce": ("ReproductionResult", "reproduce"),
    "truearm.workflows.simulate": ("SimulationResult", "rehearse", "simulate"),
    "truearm.workflows.simulate_verification": ("SimulatedVerification", "simulate_verification"),
    "truearm.recording.sources": ("SourceList", "SourceTrial", "list_sources", "try_source"),
    "truearm.workflows.task": ("TaskResult", "task"),
    "truearm.workflows.verify": ("VerificationResult", "verify"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

_MODULES = {"datasets": "truearm.datasets", "shapes": "truearm.verification.shapes"}

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
