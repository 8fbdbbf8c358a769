"""The validation suite: a chapter a family of claims, on random snakes and special ones."""
