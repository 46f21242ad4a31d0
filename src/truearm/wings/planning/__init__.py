"""Where to measure: plans, virtual arms, rehearsals, and an arm from the circles that its joints draw."""

# Public names by the module of this folder that defines them; commands by the function that has each.
NAMES = {
    "virtual": ("VirtualArm",),
    "arm_from_circles": ("CircleArm", "CirclesPlan", "arm_from_circles", "plan_circles"),
    "plan": ("CheckPlan", "PlanResult", "plan", "plan_check"),
    "simulate": ("SimulationResult", "rehearse", "simulate"),
}
COMMANDS = {"simulate": "commands:simulate", "plan": "commands:plan"}
