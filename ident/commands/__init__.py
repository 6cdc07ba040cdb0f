"""The command line, one module per command: `HELP`, `add_arguments(parser)`, `run(args) -> exit code`."""
