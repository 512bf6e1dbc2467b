"""The command line: one console command, a subcommand per process, settings from options, environment and file."""
