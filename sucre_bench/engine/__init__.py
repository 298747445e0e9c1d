"""From jobs to rows: check, restore, score, resume; a fault is a row, not the end."""
