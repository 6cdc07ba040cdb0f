"""The command line, one module per command: `add_arguments(parser)` and `run(args) -> exit code`.

The one-line helps stand here, so that `ident --help` loads no command."""

#: Commands in the order of a session, each with what it does.
COMMANDS: dict[str, str] = {
    "demo": "audit, fit, held-out error and replay on a bundled PUMA 560 log",
    "check": "audit the logs and check what they can reveal of the declared model",
    "base": "base parameters of a robot in readable expressions, and what cannot be identified",
    "fit": "estimate base and drive parameters from logs, with uncertainty and held-out error",
    "validate": "predict held-out logs with a fit: torque error per joint, replayed motion",
    "diagnose": "find what the declared model lacks, refit with it, and compare before and after on held-out data",
    "compare": "compare two saved fits (before, after) on held-out logs: torque error per joint, how the parameters moved",
    "judge": "judge whether an estimate is physically possible and consistent; repair it",
    "payload": "identify a payload: ten parameters of a real body, with uncertainty, from logs without and with it",
    "simulate": "simulate a robot along a trajectory in closed loop and write the log",
    "excite": "design an exciting trajectory within limits, and tell the accuracy to expect",
    "plan": "plan a step-by-step identification: every test, what moves where, and what it reveals",
    "monitor": "compare new logs with a saved fit and say what changed",
    "export": "write a saved fit as URDF, MJCF or JSON, with physically consistent standard parameters",
    "completion": "print a script that completes commands, flags and names in bash, zsh or fish",
    "study-schema": "print the JSON schema of study files, for editors that complete and check them",
    "report": "write the report of a kept result (folder of `ident diagnose --out`, saved fit) or of a study as one HTML file",
}
