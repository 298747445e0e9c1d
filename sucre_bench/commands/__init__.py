"""The commands, one file each: its options, one call, and the lines that it prints."""
