"""Records and findings stored in SQLite, their provenance, and work run in parallel."""
