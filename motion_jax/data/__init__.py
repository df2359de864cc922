"""Files to batches: readers and writers of motion capture and of the field's data folders."""
