"""The command line, one module per command: `add_arguments(parser)` and `run(args) -> exit code`.

The one-line helps stand here, so that `ident --help` loads no command."""

#: Commands in the order of a session, each with what it does.
COMMANDS: dict[str, str] = {
    "demo": "audit, fit, held-out error and replay on a bundled PUMA 560 log",
    "check": "audit the logs and check which parameters of the declared model they can determine",
    "base": "list a robot's base parameters as readable expressions, and what cannot be identified",
    "fit": "estimate base and drive parameters from logs, with uncertainty and held-out error",
    "validate": "validate a fit on held-out logs: torque error per joint, replayed motion",
    "diagnose": "find what the declared model is missing, refit with it, and compare before and after on held-out data",
    "compare": "compare two saved fits (before, after) on held-out logs: torque error per joint, changes in the parameters",
    "judge": "judge whether an estimate is physically possible and consistent; repair it",
    "payload": "identify a payload from logs without and with it: ten physically consistent parameters, with uncertainty",
    "simulate": "simulate a robot that tracks a trajectory in closed loop, and write the log",
    "excite": "design an exciting trajectory within the robot's limits, and predict the accuracy of the fit",
    "plan": "plan a step-by-step identification: for each test, which joints move, and which parameters it determines",
    "monitor": "compare new logs with a saved fit, and report what has changed",
    "export": "write a saved fit as URDF, MJCF or JSON, with physically consistent standard parameters",
    "completion": "print a completion script for bash, zsh or fish",
    "study-schema": "print the JSON schema of study files, for completion and checks in editors",
    "report": "write a saved result (output folder of `ident diagnose`, saved fit) or a study as one HTML report",
}
