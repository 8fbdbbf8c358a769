"""Reports: tables and figures made of Findings and Records; they compute nothing."""
