"""Studies: measured, stored as Records, shown as tables and charts, and reported."""
