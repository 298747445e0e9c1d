"""From jobs to rows: check, restore, score, resume. A fault becomes a row, and the other views continue."""
