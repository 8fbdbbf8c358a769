"""Tables and figures: they read Findings and Records and compute nothing."""
