"""
Without an instrument: seats and a bar
======================================

A ball on the stylus, some cone seats and a bar of certified length identify an arm. Readings in one seat say that the
tip was at one point; the bar gives the scale.
"""

import truearm as ta

arm = ta.load_arm("measuring7")
options = {"strategy": "seat", "reference": False, "seats": 3, "bars": 4, "bar_mm": 500.0}
taken = ta.simulate(arm, poses=165, **options)
taken.lengths.to_frame()

# %%
# Ten readings of the session; no reference point, but the name of a seat:

taken.session.to_frame().head(10).round(2)

# %%
fit = ta.fit(arm, taken.session, lengths=taken.lengths, model="physical")
print(fit)

# %%
# On another day, in seats elsewhere. The bar tests the scale:

other = ta.simulate(arm, poses=77, seed=1, **options)
print(ta.evaluate(fit.model, other.session, lengths=other.lengths))
