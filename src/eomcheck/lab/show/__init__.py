"""Tables, charts, figures and files."""
