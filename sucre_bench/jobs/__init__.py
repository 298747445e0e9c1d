"""From the words of a command to validated jobs, and back."""
