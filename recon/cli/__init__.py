"""The command line: `reconstruct --help`."""

from recon.cli.commands import COMMANDS, main

__all__ = ["COMMANDS", "main"]
