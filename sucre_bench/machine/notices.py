"""Notices: lines on stderr, in colour, about faults and what a user should know."""


def say(text: str, colour: str) -> None:
    """Print a line on stderr, in colour if stderr is a terminal that wants colours."""
    from rich.text import Text

    from sucre_bench.machine import terminal
    from sucre_bench.machine.records import masked

    terminal.err.print(Text(masked(text), style=colour), soft_wrap=True)
