"""What everything else stands on: errors, units, a cache on disk."""
