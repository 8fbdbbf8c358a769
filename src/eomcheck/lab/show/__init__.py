"""Tables, charts, pictures and text of documents."""
