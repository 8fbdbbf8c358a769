"""The validation suite: one file per claim, on hypothesis's random snakes and special ones."""
