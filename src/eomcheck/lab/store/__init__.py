"""What is kept: Records, where they come from, and work that can be resumed."""
