"""One arm of each build, for laws that would take long for the whole catalogue."""

ARMS = ("gao2017", "gen3lite", "kr6r900", "measuring7", "panda", "ur10", "ur5", "wam")
