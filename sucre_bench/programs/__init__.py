"""One program for each command that runs no methods. No program imports another."""
