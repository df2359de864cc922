"""What a running program needs: kept programs, times, progress, a folder's lock, how it ends."""
