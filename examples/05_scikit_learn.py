"""
Models are scikit-learn regressors
==================================

Cross-validation by position, pipelines and ``clone`` work as with any regressor: angles in rad in, points in mm out.
"""

from sklearn.model_selection import GroupKFold, cross_val_score

import truearm as ta

arm = ta.load_arm("gao2017")
session = ta.simulate(arm, poses=200, strategy="measuring", seed=4).session
groups = [i // 2 for i in range(len(session))]  # readings of one position stay together

for model in (ta.NominalModel(arm), ta.KinematicModel(arm)):
    scores = cross_val_score(
        model, session.angles, session.points, groups=groups, cv=GroupKFold(5), scoring="neg_mean_absolute_error"
    )
    print(f"{type(model).__name__:16s} mean absolute coordinate error {-scores.mean():.4f} mm")
