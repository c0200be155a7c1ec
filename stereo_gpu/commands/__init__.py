"""One module a subcommand: its first line says what it does, `add_options` what it takes, `run` does it."""
