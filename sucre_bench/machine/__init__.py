"""Everything about this computer: files, memory, cores, terminal, progress, provenance."""
