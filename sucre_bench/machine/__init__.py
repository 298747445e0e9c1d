"""What is asked of this computer: files, memory, cores, terminal, progress, provenance."""
