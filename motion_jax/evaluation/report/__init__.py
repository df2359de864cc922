"""What a result looks like: tables beside the papers' numbers, charts, a page."""
