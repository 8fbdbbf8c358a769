"""The field's words: records, scenes, and what scenes are put together from."""
