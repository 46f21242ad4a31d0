"""
Models are scikit-learn regressors
==================================

Cross-validation by position, pipelines and ``clone`` work as with any regressor: angles in rad in, points in mm out.
"""

import matplotlib.pyplot as plt
from sklearn.model_selection import GroupKFold, cross_val_score

import truearm as ta

arm = ta.load_arm("gao2017")
session = ta.simulate(arm, poses=200, strategy="measuring", seed=4).session
groups = [i // 2 for i in range(len(session))]  # readings of one position stay together

means = {}
for model in (ta.NominalModel(arm), ta.KinematicModel(arm)):
    scores = cross_val_score(
        model, session.angles, session.points, groups=groups, cv=GroupKFold(5), scoring="neg_mean_absolute_error"
    )
    means[type(model).__name__] = -scores
    print(f"{type(model).__name__:16s} mean absolute coordinate error {-scores.mean():.4f} mm")

# %%
# Every fold says the same. A single split would not tell whether it was luck:

for row, (name, scores) in enumerate(means.items()):
    plt.plot(scores, [row] * len(scores), "o", ms=9, alpha=0.6, label=name)
plt.xscale("log")
plt.ylim(-0.7, 1.7)
plt.yticks(range(len(means)), list(means))
plt.xlabel("mean absolute coordinate error of a fold [mm]")
