"""The command line: one console command with a subcommand per process; settings from options, environment, file."""
